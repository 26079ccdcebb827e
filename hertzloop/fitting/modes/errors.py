"""The error of data that cannot become modes."""


class ModalDataError(ValueError):
    """A file cannot become modes. The message names the field, its value and the remedy."""

    exit_status = 2
