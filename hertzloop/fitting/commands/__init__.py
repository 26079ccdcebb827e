"""The command `fit`."""
