"""Read the measured records of a file."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.common.text_files import text_of
from hertzloop.identification.records.contents import FileContents
from hertzloop.identification.records.errors import RecordError, TableError
from hertzloop.identification.records.formats import ENDINGS, format_of
from hertzloop.identification.records.measurement import Measurement, parse_record_table
from hertzloop.identification.records.quantities import NAMES, known_quantity, quantity_of
from hertzloop.identification.records.record import FEWEST_SAMPLES, Record
from hertzloop.identification.records.series_choice import choose_series
from hertzloop.identification.records.series_times import times_of_series
from hertzloop.identification.records.series_units import resolve_unit, si_factor
from hertzloop.identification.records.toml_tables import tables_in_toml

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
    if beside.is_file() and (named := _toml_tables(beside)):
        tables = [(tables[0] if len(tables) == 1 else {}) | table for table in named]
    chosen = {key: value for key, value in (given or {}).items() if key in _CHOICES}
    if len(tables) > 1 and chosen:
        tables = _tables_of(contents, tables, chosen)
    digest = ""
    if path.stat().st_size < 1 << 30:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    found: list[Record] = []
    for table in tables:
        whole = contents.facts | table | dict(given or {})
        measurement = parse_record_table(whole, path.name)
        one = _build_record(contents, measurement, "sensitivity" in whole, digest)
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
    return known or (path.suffix == ".toml" and path.is_file() and bool(_toml_tables(path)))


def _read_record_list(path: Path, given: dict[str, Any]) -> list[Record]:
    """Read the records of a TOML file whose tables name the files. Raises RecordError."""
    found = []
    for table in _toml_tables(path):
        if not isinstance(file := table.pop("file", None), str):
            raise RecordError(
                f"record.file: a [[record]] table of {path.name} names no file. Give the path of "
                "its record, relative to this file."
            )
        found += read_records(path.parent / file, table | given)
    if not found:
        raise RecordError(f"{path}: has no [[record]] table. Give one for each channel.")
    return found


def _toml_tables(path: Path) -> list[dict[str, Any]]:
    """Return the `[record]` or `[[record]]` tables of a TOML file. Raises RecordError."""
    try:
        return tables_in_toml(text_of(path.read_bytes()))
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from None
    except (OSError, ValueError) as error:
        raise RecordError(f"{path}: is not valid TOML: {error}.") from error


def _read_contents(path: Path) -> FileContents:
    """Return what a file holds. Raises RecordError and ModuleNotFoundError."""
    if not path.is_file():
        raise RecordError(f"{path}: there is no such file. Give the path of a record.")
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


def _build_record(
    contents: FileContents, measurement: Measurement, sensitivity_given: bool, digest: str
) -> Record:
    """Return the record of a file.

    Args:
        contents: of the file.
        measurement: the `[record]` table.
        sensitivity_given: whether the table states a sensitivity.
        digest: of the file.

    Raises:
        RecordError: the file holds no record, or several that the table does not choose from.
    """
    name = contents.name
    if not contents.series or all(len(one.values) == 0 for one in contents.series):
        reasons = " ".join(contents.notes)
        raise RecordError(f"{name}: has no samples. {reasons or 'Give a record of one impact.'}")
    notes = [f"{name}: {note}" for note in contents.notes]
    series, more = choose_series(contents, measurement)
    notes += more
    named = NAMES.get(measurement.quantity or "", measurement.quantity)
    quantity = known_quantity(named or quantity_of(series.name), name)
    measurement, words, more = resolve_unit(
        series, quantity, contents, measurement, sensitivity_given
    )
    notes += more
    factor = si_factor(quantity, measurement) / series.levels
    value = series.values
    if factor != 1.0 or series.zero or value.dtype != float:
        value = np.subtract(value, series.zero, dtype=float)
        value *= factor
    time_s, times = times_of_series(series, contents, measurement)
    if len(time_s) == len(value):
        time_s, value = _with_times(name, time_s, value, notes)
    number = np.count_nonzero(np.isfinite(value))
    if gone := len(value) - number:
        if number < max(FEWEST_SAMPLES, 0.5 * len(value)):
            raise RecordError(
                f"{name}: {gone} of {len(value)} samples are not numbers. Give a record without "
                "gaps."
            )
        notes.append(f"{name}: {gone} samples are not numbers and are not used.")
    lines = f"{contents.above} line{'s' * (contents.above != 1)}"
    above = f"; {lines} above the table" if contents.above else ""
    source = f"time: {times}; {quantity}: {contents.describe(series)} in {words}{above}"
    measurement = replace(measurement, quantity=quantity)
    return Record(name, time_s, value, quantity, measurement, digest, tuple(notes), source)


def _with_times(
    name: str, time_s: np.ndarray, value: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples that have a time, and add a note on others. Raises RecordError if none
    has."""
    if not (np.isfinite(time_s[-1]) or np.isfinite(value[-1])):  # beside a longer table
        ends = np.isfinite(time_s) | np.isfinite(value)
        last = len(ends) - int(np.argmax(ends[::-1])) if np.any(ends) else 0
        time_s, value = time_s[:last], value[:last]
    known = np.isfinite(time_s)
    number = np.count_nonzero(known)
    if number == 0:
        raise RecordError(
            f"{name}: no time is a number. Write numbers with a decimal point, in seconds."
        )
    if number == len(time_s):
        return time_s, value
    notes.append(f"{name}: {len(time_s) - number} samples have no time and are not used.")
    return time_s[known], value[known]
