"""Measured structures: modes of universal files and from frequency responses, as a mode file."""
