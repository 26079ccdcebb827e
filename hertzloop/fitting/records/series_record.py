"""The record of a series: its values and times in SI units."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hertzloop.fitting.records.contents import FileContents
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.measurement import parse_record_table
from hertzloop.fitting.records.quantities import known_quantity, quantity_of
from hertzloop.fitting.records.record import FEWEST_SAMPLES, Record
from hertzloop.fitting.records.series_choice import choose_series
from hertzloop.fitting.records.series_times import times_of_series
from hertzloop.fitting.records.series_units import resolve_unit, si_factor


def build_record(contents: FileContents, table: Mapping[str, Any], digest: str) -> Record:
    """Return the record of a file.

    Args:
        contents: of the file.
        table: its `[record]` table, with the keys that are given.
        digest: of the file.

    Raises:
        RecordError: a key is wrong, or the file holds no record, or several that the table does not
            choose from.
    """
    name, measurement = contents.name, parse_record_table(table, contents.name)
    if not contents.series or all(len(one.values) == 0 for one in contents.series):
        reasons = " ".join(contents.notes)
        raise RecordError(f"{name}: has no samples. {reasons or 'Give a record of one impact.'}")
    notes = [f"{name}: {note}" for note in contents.notes]
    series, more = choose_series(contents, measurement)
    notes += more
    quantity = known_quantity(measurement.quantity or quantity_of(series.name), name)
    measurement, words, more = resolve_unit(
        series, quantity, contents, measurement, "sensitivity" in table
    )
    notes += more
    factor = si_factor(quantity, measurement) / series.levels
    value = np.subtract(series.values, series.zero, dtype=float)
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
    rows = np.flatnonzero(np.isfinite(time_s) | np.isfinite(value))
    end = rows[-1] + 1 if len(rows) else 0  # A longer table may stand beside this one.
    time_s, value = time_s[:end], value[:end]
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
