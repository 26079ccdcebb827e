"""Errors of measured records and of the tables in text files."""


class RecordError(ValueError):
    """A record cannot be used. The message names the field, its value and the remedy."""

    exit_status = 2


class TableError(ValueError):
    """A text file is no table, or could be read in two ways. The message says what to do."""

    exit_status = 2


def shorten(line: str) -> str:
    return line.strip()[:40]
