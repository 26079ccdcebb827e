"""Measurements of the tool, as programs that run from a clone: python -m benchmarks.NAME."""
