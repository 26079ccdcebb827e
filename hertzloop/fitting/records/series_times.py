"""Times of a series: of a column, of the file, or by a rate."""

import math
from collections.abc import Sequence

import numpy as np

from hertzloop.fitting.records.contents import FileContents, Series, is_series
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.series_units import agreed_unit
from hertzloop.fitting.records.spacing import StatedSpacing
from hertzloop.fitting.records.text.column_names import TIMES
from hertzloop.fitting.records.units import StatedUnit, unit_of

_NOT_STATED = "s, which the file does not state"


def times_of_series(
    series: Series, contents: FileContents, measurement: Measurement
) -> tuple[np.ndarray, str]:
    """Find the times of a series.

    Returns:
        Times, s, shape (samples,), and words on where they come from.

    Raises:
        RecordError: there are none, or what says them disagrees.
    """
    name, rate, count = contents.name, measurement.rate_hz, len(series.values)
    if measurement.time_column is None and series.time_s is not None:
        return _check_times(series.time_s, f"of the {contents.kind}", contents, measurement)
    if found := _time_columns(series, contents, measurement):
        return _check_times(*_agreed_times(found, contents, measurement), contents, measurement)
    if contents.spacing is not None:
        step, _, words = contents.spacing
        if rate and abs(rate * step - 1.0) > 1e-2:
            raise RecordError(
                f"record.rate_hz = {rate:g}: '{words}' in {name} says {1.0 / step:.9g} Hz. Leave "
                "record.rate_hz out, or correct it."
            )
        return _even_times(count, contents.spacing, contents), f"{step:.9g} s apart by '{words}'"
    if rate:
        return _times_at_rate(count, rate, contents)
    raise RecordError(
        f"{name}: has no column time_s; the columns are "
        f"{', '.join(s.name or str(s.number) for s in contents.series)}. Add one, give "
        "record.time_column, or give record.rate_hz in samples per second. "
        f"{' '.join(contents.notes)}".strip()
    )


def _time_columns(series: Series, contents: FileContents, measurement: Measurement) -> list[Series]:
    """Return the columns that may hold the times of a series."""
    if measurement.time_column is not None:
        found = [s for s in contents.series if is_series(s, measurement.time_column)]
        if len(found) > 1:
            found = [s for s in found if s.group == series.group] or found
        if len(found) != 1:
            raise RecordError(
                f"record.time_column = {measurement.time_column!r}: means {len(found)} columns of "
                f"{contents.name}. Give the number of one of "
                f"{contents.describe(*contents.series)}."
            )
        return found
    found = [
        s
        for s in contents.series
        if s.is_time and len(s.values) == len(series.values) and s.group in (series.group, "")
    ]
    rising = [s for s in found if np.nanmax(s.values, initial=0) > np.nanmin(s.values, initial=0)]
    return rising or found[:1]


def _agreed_times(
    columns: Sequence[Series], contents: FileContents, measurement: Measurement
) -> tuple[np.ndarray, str]:
    """Return the times of the last of several columns, and words. Raises RecordError if they
    disagree."""
    first, *others = [_times_in_seconds(s, contents, measurement) for s in columns]
    for time_s, words in others:
        shift = (time_s - time_s[0]) - (first[0] - first[0][0])
        if not np.nanmax(np.abs(shift)) < 0.5 * np.nanmedian(np.abs(np.diff(time_s))):
            raise RecordError(
                f"{contents.name}: two columns of times disagree: {first[1]} and {words}. Choose "
                f"one, for example record.time_column = {columns[0].number}."
            )
    return others[-1] if others else first


def _times_at_rate(count: int, rate_hz: float, contents: FileContents) -> tuple[np.ndarray, str]:
    """Return times by the rate of the `[record]` table, s, (count,), and words on them."""
    words = f"record.rate_hz = {rate_hz:g}"
    return _even_times(count, StatedSpacing(1.0 / rate_hz, 0.0, words), contents), f"by {words}"


def _even_times(count: int, spacing: StatedSpacing, contents: FileContents) -> np.ndarray:
    """Return evenly spaced times, s, (count,). Raises RecordError if rows may be missing."""
    if contents.interrupted:
        raise RecordError(
            f"{contents.name}: empty lines stand between rows without times. Fill or remove them."
        )
    return spacing.times(count)


def _times_in_seconds(
    series: Series, contents: FileContents, measurement: Measurement
) -> tuple[np.ndarray, str]:
    """Return times in s and words on them. Raises RecordError for an unknown unit."""
    stated = measurement.time_unit or agreed_unit(series, TIMES, contents)
    unit = unit_of(stated) if stated else StatedUnit("s", 1.0, "s")
    if unit is None or unit.si != "s":
        raise RecordError(
            f"record.time_unit: '{stated}' of {contents.describe(series)} in {contents.name} is "
            "not a known unit of time. Give one of s, ms, us, ns."
        )
    words = unit.symbol if stated else _NOT_STATED
    values = np.asarray(series.values, float)
    return values * unit.size, f"{contents.describe(series)} in {words}"


def _check_times(
    time_s: np.ndarray, words: str, contents: FileContents, measurement: Measurement
) -> tuple[np.ndarray, str]:
    """Return times and words on them. Raises RecordError for times that disagree with the rate in
    the table or, by a power of ten, with the spacing that the file states."""
    name, rate, spacing = contents.name, measurement.rate_hz, contents.spacing
    known = time_s[np.isfinite(time_s)]
    mean = (known[-1] - known[0]) / (len(known) - 1) if len(known) > 1 else 0.0
    if rate and mean > 0.0 and abs(rate * mean - 1.0) > 1e-2:
        raise RecordError(
            f"record.rate_hz = {rate:g}: the times of {name} ({words}) say {1.0 / mean:.6g} Hz. "
            "Leave record.rate_hz out, or correct it."
        )
    if rate and np.any(known[1:] <= known[:-1]):  # rounded times
        return _times_at_rate(len(time_s), rate, contents)
    if spacing is not None and _NOT_STATED in words and mean > 0.0:
        turns = math.log10(mean / spacing.step_s)
        if abs(turns) > 2.5 and abs(turns - round(turns)) < 1e-3:
            raise RecordError(
                f"{name}: times without a unit rise by {mean:.6g}, and '{spacing.stated_by}' "
                f"says {spacing.step_s:.6g} s. Give record.time_unit."
            )
    if spacing is not None and abs(mean / spacing.step_s - 1.0) > 1e-2:
        words += f" ({mean:.6g} s apart, not {spacing.step_s:.6g} s as '{spacing.stated_by}')"
    falls = bool(np.any(known[1:] < known[:-1]))  # which the record refuses, with the sample
    apart_s = float(np.spacing(max(np.max(known), -np.min(known)))) if mean > 0.0 else 0.0
    if apart_s > 0.01 * mean and not falls:
        raise RecordError(
            f"{name}: its times are so large that a double holds them to {apart_s:.2g} s only. "
            "Leave time_s out and give record.rate_hz."
        )
    return time_s, words
