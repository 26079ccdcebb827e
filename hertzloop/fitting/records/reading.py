"""Make measured records of a file: choose columns, convert units, find the times."""

import hashlib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.common.text_files import text_of
from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.records.files import ENDINGS, FileContents, read_file
from hertzloop.fitting.records.measurement import Measurement, parse_record_table
from hertzloop.fitting.records.quantities import (
    QUANTITIES,
    UNITS,
    known_quantity,
    quantity_of,
    split_heading,
    symbol_of,
    units_of,
)
from hertzloop.fitting.records.record import Record

_TIMES = ("time", "t")


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
    """Read the records of a file: one for each `[[record]]` table beside it, or one.

    Args:
        path: a file with one of the `ENDINGS`.
        given: keys of the `[record]` table that replace those of the file.

    Raises:
        RecordError: the file cannot be read, a table is wrong, or a choice is left open.
    """
    tables = [table | dict(given or {}) for table in _tables_beside(path)]
    found = [_read_one(path, table) for table in tables]
    if len(found) > 1:
        found = [replace(one, name=f"{path.name}, {one.quantity}") for one in found]
    return found


def holds_records(path: Path) -> bool:
    """Whether the name of a file says that it holds records."""
    return path.suffix.lower() in ENDINGS


def input_files(path: Path) -> list[Path]:
    """Return the files that `read_records` may read for a path, whether or not they exist."""
    return [path, path.with_suffix(".toml")]


def _tables_beside(path: Path) -> list[dict[str, Any]]:
    """Return the `[record]` or `[[record]]` tables of the TOML file beside a file."""
    beside = path.with_suffix(".toml")
    if not beside.is_file():
        return [{}]
    try:
        found = tomllib.loads(text_of(beside.read_bytes())).get("record", {})
    except (OSError, ValueError) as error:
        raise RecordError(f"{beside}: is not valid TOML: {error}.") from error
    tables = found if isinstance(found, list) and found else [found or {}]
    if not all(isinstance(table, dict) for table in tables):
        raise RecordError(f"{beside}: record is not a table. Write [record] or [[record]].")
    return tables


def _read_one(path: Path, table: dict[str, Any]) -> Record:
    """Return the record that one table describes."""
    name = path.name
    contents = read_file(path, parse_record_table(table, name).decimal)
    table = contents.facts | table
    measurement = parse_record_table(table, name)
    column = _value_column(contents, measurement, name)
    quantity = known_quantity(measurement.quantity or quantity_of(column), name)
    measurement = replace(
        measurement, quantity=quantity, unit=_unit_of(column, quantity, table, name)
    )
    time_s, times = _times(contents, measurement, column, name)
    value = contents.columns[column] * si_factor(quantity, measurement)
    value[~np.isfinite(value)] = np.nan
    known = np.isfinite(time_s)
    notes = [f"{name}: {note}" for note in contents.notes]
    if missing := int(np.count_nonzero(~known)):
        notes.append(f"{name}: {missing} samples have no time and are not used.")
    if missing := int(np.count_nonzero(np.isnan(value[known]))):
        notes.append(f"{name}: {missing} samples are not numbers and are not used.")
    place = list(contents.columns).index(column) + 1
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return Record(
        name,
        time_s[known],
        value[known],
        quantity,
        measurement=measurement,
        clock=str(path),
        sha256=digest,
        notes=tuple(notes),
        source=f"time: {times}; {quantity}: column {place} '{column}' in "
        f"{measurement.unit or 'an unknown unit'}",
    )


def _value_column(contents: FileContents, measurement: Measurement, name: str) -> str:
    """Return the name of the column with the values. Raises RecordError if none or several can be
    meant."""
    if measurement.column is not None:
        return _chosen("column", measurement.column, contents, name)
    columns = [one for one in contents.columns if split_heading(one)[0] not in _TIMES]
    if len(columns) != 1 or measurement.quantity is None:
        wanted = measurement.quantity
        columns = [one for one in columns if quantity_of(one) in ((wanted,) if wanted else KNOWN)]
    if len(columns) != 1:
        what = "no column is a known quantity" if not columns else "several columns could be meant"
        raise RecordError(
            f"{name}: {what}; the columns are {', '.join(contents.columns) or 'not numbers'}. Name "
            "a column such as contact_force_n or v_p_m_s, or choose one with record.column and say "
            "record.quantity."
        )
    return columns[0]


KNOWN = tuple(QUANTITIES)


def _chosen(key: str, said: str | int, contents: FileContents, name: str) -> str:
    """Return the column that a key of the table means, by its name or number."""
    columns = list(contents.columns)
    if isinstance(said, int) and said <= len(columns):
        return columns[said - 1]
    if said not in columns:
        raise RecordError(
            f"record.{key} = {said!r}: not a column of {name}. Its columns are "
            f"{', '.join(columns)}."
        )
    return str(said)


def _unit_of(column: str, quantity: str, table: Mapping[str, Any], name: str) -> str:
    """Return the unit of the values, by the key or by the name of the column.

    Raises:
        RecordError: neither states a unit, or both do and differ.
    """
    stated, given = split_heading(column)[1], symbol_of(table.get("unit", ""))
    si = QUANTITIES[quantity].unit
    if table.get("sensitivity_uncertainty") == math.inf:
        return given or stated
    if "sensitivity" in table and stated not in units_of(si):
        stated = ""  # the unit of the instrument, such as V
    return _one_unit("unit", column, stated, given, si, name)


def _one_unit(key: str, column: str, stated: str, given: str, si: str, name: str) -> str:
    """Return the unit that a name or a key states. Raises RecordError if there is not one."""
    units = units_of(si)
    if given and stated and given != stated:
        raise RecordError(
            f"record.{key} = '{given}': the column '{column}' of {name} says '{stated}'. Remove "
            "one of the two."
        )
    found = given or stated
    if not found:
        raise RecordError(
            f"{name}: the column '{column}' states no unit: it may be in {units[0]} or in "
            f"{units[1]}. Give record.{key}, or end the name in the unit, as in "
            f"'{column} [{units[0]}]'."
        )
    if found not in units:
        remedy = "" if key == "time_unit" else ", or record.sensitivity"
        raise RecordError(
            f"{name}: the column '{column}' is in '{found}', which is not one of "
            f"{', '.join(units)}. Give record.{key}{remedy}."
        )
    return found


def si_factor(quantity: str, measurement: Measurement) -> float:
    """Return the SI value of one unit of the file."""
    unit = UNITS.get(measurement.unit)
    known = unit is not None and unit.si == QUANTITIES[quantity].unit
    return (unit.size if unit is not None and known else 1.0) / measurement.sensitivity


def _times(
    contents: FileContents, measurement: Measurement, column: str, name: str
) -> tuple[np.ndarray, str]:
    """Return the times of the samples, s, and words on where they come from.

    Raises:
        RecordError: there are none, or the rate contradicts them.
    """
    rate, choice = measurement.rate_hz, measurement.time_column
    found = [one for one in contents.columns if split_heading(one)[0] in _TIMES]
    if choice is not None:
        found = [_chosen("time_column", choice, contents, name)]
    if rate is not None:
        if found:
            raise RecordError(
                f"record.rate_hz = {rate:g}: {name} has times in the column '{found[0]}'. Remove "
                "the key or the column."
            )
        return np.arange(len(contents.columns[column])) / rate, f"by record.rate_hz = {rate:g}"
    if len(found) != 1:
        raise RecordError(
            f"{name}: {len(found)} columns are times; the columns are "
            f"{', '.join(contents.columns)}. Name a column time_s or time_us, choose one with "
            "record.time_column, or give record.rate_hz in samples per second."
        )
    stated, given = split_heading(found[0])[1], symbol_of(measurement.time_unit)
    unit = _one_unit("time_unit", found[0], stated, given, "s", name)
    time_s = contents.columns[found[0]] * UNITS[unit].size
    if len(time_s) != len(contents.columns[column]):
        raise RecordError(
            f"{name}: '{found[0]}' has {len(time_s)} values, '{column}' "
            f"{len(contents.columns[column])}. Give one value for each time."
        )
    return time_s, f"column '{found[0]}' in {unit}"
