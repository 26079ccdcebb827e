"""The error of a fit that is asked for in a wrong way."""


class FitError(ValueError):
    """A key cannot be fitted as asked. The message says why."""

    exit_status = 2
