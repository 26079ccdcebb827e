"""The published study again, as programs that run from a clone: python -m paper.NAME."""
