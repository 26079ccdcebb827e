"""Search for the best law and parameters."""
