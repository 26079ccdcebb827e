"""`[record]` tables in TOML files and in the comments of other files."""

import re
import tomllib
from pathlib import Path
from typing import Any

from hertzloop.common.text_files import text_of
from hertzloop.fitting.records.errors import RecordError


def tables_of_toml_file(path: Path) -> list[dict[str, Any]]:
    """Return the `[record]` or `[[record]]` tables of a TOML file. Raises RecordError."""
    try:
        return _tables_in_toml(text_of(path.read_bytes()))
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from None
    except (OSError, ValueError) as error:
        raise RecordError(f"{path}: is not valid TOML: {error}.") from error


def _tables_in_toml(text: str) -> list[dict[str, Any]]:
    """Return the tables of a TOML text. Raises TOMLDecodeError and RecordError."""
    found = tomllib.loads(text).get("record", [])
    tables = found if isinstance(found, list) else [found]
    for table in tables:
        if not isinstance(table, dict):
            raise RecordError(f"record = {found!r}: is not a table. Write [record] or [[record]].")
        # A list that names lists could name itself.
        if isinstance(file := table.get("file"), str) and file.endswith(".toml"):
            raise RecordError(
                f"record.file = '{file}': is a TOML file. Give the path of a file with samples."
            )
    return tables


def tables_in_comments(text: str | bytes) -> list[dict[str, Any]]:
    """Return the `[record]` tables of comment lines, at least one; other comments mean nothing.
    Raises RecordError."""
    said = text.decode("utf-8") if isinstance(text, bytes) else str(text)
    first = re.search(r"\[?\[record\]", said)
    try:
        return (_tables_in_toml(said[first.start() :]) if first else []) or [{}]
    except tomllib.TOMLDecodeError as error:
        raise RecordError(
            f"the record table in the comments is not valid TOML: {error}."
        ) from error
