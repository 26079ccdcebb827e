"""The error of a measured record."""


class RecordError(ValueError):
    """A record cannot be used. The message names the field, its value and the remedy."""

    exit_status = 2
