"""Simulate what an instrument sees of an impact, for other values of the keys."""
