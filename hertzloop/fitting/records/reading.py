"""Read the measured records of a file."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.common.missing_files import why_unreadable
from hertzloop.fitting.records.contents import FileContents
from hertzloop.fitting.records.errors import RecordError, TableError
from hertzloop.fitting.records.formats import ENDINGS, format_of
from hertzloop.fitting.records.measurement import parse_record_table
from hertzloop.fitting.records.quantities import NAMES
from hertzloop.fitting.records.record import Record
from hertzloop.fitting.records.record_tables import tables_of_toml_file
from hertzloop.fitting.records.series_choice import choose_series
from hertzloop.fitting.records.series_record import build_record

_CHOICES = ("quantity", "column", "channel", "group")  # keys that choose a series


def read_record(path: Path, given: Mapping[str, Any] | None = None) -> Record:
    """Read a file of one record. Arguments and errors are those of `read_records`."""
    found = read_records(path, given)
    if len(found) > 1:
        raise RecordError(
            f"{path}: holds {len(found)} records, one for each [[record]] table. Read them with "
            "read_records."
        )
    return found[0]


def read_records(path: Path, given: Mapping[str, Any] | None = None) -> list[Record]:
    """Read the records of a file: one for each of its `[[record]]` tables, or one.

    Args:
        path: a file of one of the formats in `formats.FORMATS`, or a TOML file whose tables name
            such files, relative to it.
        given: keys of the `[record]` table that replace those of the file.

    Raises:
        RecordError: the file is not a record, a table is wrong, or it does not say which channel.
        ModuleNotFoundError: the format needs a package of an extra.
    """
    if path.suffix == ".toml":
        return _read_record_list(path, dict(given or {}))
    contents = _read_contents(path)
    tables, beside = contents.tables, path.with_suffix(".toml")
    # A list of records beside the file has tables with the key `file`.
    named = tables_of_toml_file(beside) if beside.is_file() else []
    if about := [table for table in named if "file" not in table]:
        tables = [(tables[0] if len(tables) == 1 else {}) | table for table in about]
    chosen = {key: value for key, value in (given or {}).items() if key in _CHOICES}
    if len(tables) > 1 and chosen:
        tables = _tables_of(contents, tables, chosen)
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    found: list[Record] = []
    for table in tables:
        one = build_record(contents, contents.facts | table | dict(given or {}), digest)
        if len(tables) > 1:
            one = replace(one, name=f"{path.name}, {one.quantity}")
            if np.array_equal(one.time_s, (found or [one])[0].time_s):
                measurement = replace(one.measurement, clock=one.measurement.clock or path.name)
                one = replace(one, measurement=measurement, time_s=(found or [one])[0].time_s)
        found.append(one)
    return found


def _tables_of(
    contents: FileContents, tables: list[dict[str, Any]], chosen: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Return the tables of the series that some keys choose; an empty one if none describes it.
    Raises RecordError if the keys choose none."""

    def known(value: Any) -> Any:
        return NAMES.get(str(value), value)

    alike = [
        table
        for table in tables
        if all(known(table.get(key)) == known(value) for key, value in chosen.items())
    ]
    if alike:
        return alike

    def place_of(table: Mapping[str, Any]) -> tuple[str, int]:
        measurement = parse_record_table(contents.facts | dict(table), contents.name)
        series = choose_series(contents, measurement)[0]
        return series.group, series.number

    # A column has a name and a number.
    wanted = place_of(chosen)
    return [table for table in tables if place_of(table) == wanted] or [{}]


def holds_records(path: Path) -> bool:
    """Whether the name of a file, or what is in a TOML file, says that it holds records."""
    known = path.suffix.lower() in ENDINGS
    return known or (path.suffix == ".toml" and path.is_file() and bool(tables_of_toml_file(path)))


def input_files(path: Path) -> list[Path]:
    """Return the files that `read_records` may read for a path, whether or not they exist."""
    if path.suffix != ".toml":
        return [path, path.with_suffix(".toml")]
    named = tables_of_toml_file(path) if path.is_file() else []
    files = [path.parent / table["file"] for table in named if isinstance(table.get("file"), str)]
    return [path, *(one for file in files for one in input_files(file))]


def _read_record_list(path: Path, given: dict[str, Any]) -> list[Record]:
    """Read the records of a TOML file whose tables name the files. Raises RecordError."""
    found = []
    for table in tables_of_toml_file(path):
        if not isinstance(file := table.pop("file", None), str):
            raise RecordError(
                f"record.file: a [[record]] table of {path.name} names no file. Give the path of "
                "its record, relative to this file."
            )
        found += read_records(path.parent / file, table | given)
    if not found:
        raise RecordError(f"{path}: has no [[record]] table. Give one for each channel.")
    return found


def _read_contents(path: Path) -> FileContents:
    """Return what a file holds. Raises RecordError and ModuleNotFoundError."""
    if not path.is_file():
        why = why_unreadable(path, FileNotFoundError(), "Give the path of a record.")
        raise RecordError(f"{path}: cannot be read: {why}")
    if path.suffix.lower() not in ENDINGS:
        raise RecordError(
            f"{path}: '{path.suffix}' is not a known format. Give one of "
            f"{', '.join(sorted(ENDINGS))}."
        )
    try:
        return replace(format_of(path).read(path), name=path.name)
    except (RecordError, ModuleNotFoundError):
        raise
    except TableError as error:
        raise RecordError(f"{path}: {error}.") from error
    except Exception as error:  # every library has its own ways to say that a file is damaged
        words = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordError(f"{path}: cannot be read as {path.suffix[1:]}: {words}.") from error
