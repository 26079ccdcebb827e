"""Response times of a paced run."""
