"""A run, a sweep or a tuning as one page that needs nothing else."""
