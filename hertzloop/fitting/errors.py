"""Errors of records and of fits."""


class RecordError(ValueError):
    """A record cannot be used. The message names the field, its value and the remedy."""

    exit_status = 2


class FitError(ValueError):
    """A key cannot be fitted as asked. The message says why."""

    exit_status = 2
