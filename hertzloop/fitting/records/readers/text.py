"""Read text tables, and the segments of LabVIEW's LVM files."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np

from hertzloop.fitting.records.contents import FileContents, Series
from hertzloop.fitting.records.errors import TableError
from hertzloop.fitting.records.record_tables import tables_in_comments
from hertzloop.fitting.records.spacing import stated_spacing
from hertzloop.fitting.records.text.column_names import SAMPLE_NUMBERS, is_time
from hertzloop.fitting.records.text.fact_names import (
    MULTIPLIER_FACTS,
    TIME_UNIT_FACTS,
    VALUE_UNIT_FACTS,
    stated_fact,
)
from hertzloop.fitting.records.text.reading import decode_text, read_table, read_text
from hertzloop.fitting.records.text.table import TextColumn, TextTable
from hertzloop.fitting.records.units import name_and_unit, plain_name, unit_of


def read_text_table(path: Path) -> FileContents:
    """Read a text table. Raises TableError."""
    return contents_of_table(read_table(path))


def read_lvm(path: Path) -> FileContents:
    """Read an LVM file: every segment is a text table with facts above it. Raises TableError."""
    text = decode_text(path.read_bytes())
    starts = [one.start() for one in re.finditer(r"^Channels\b", text, re.MULTILINE)]
    if len(starts) < 2:
        return contents_of_table(read_text(text))
    found = FileContents([])
    for i, (start, end) in enumerate(pairwise([*starts, len(text)]), 1):
        part = contents_of_table(read_text(text[: starts[0]] + text[start:end]))
        several = len({one.group for one in part.series}) > 1
        spacing = None if any(one.is_time for one in part.series) else part.spacing
        found.series += [
            one._replace(
                group=f"{i}, {one.group}" if several else str(i),
                time_s=spacing.times(len(one.values)) if spacing else None,
            )
            for one in part.series
        ]
        found.notes += part.notes
    return found


def contents_of_table(table: TextTable) -> FileContents:
    """Return the series of a text table, without columns that number the samples.

    A column of times begins a new group, unless the times stand behind the values.
    """
    found = FileContents(
        [], tables_in_comments(table.comments), None, list(table.notes), table.above
    )
    try:
        found.spacing = stated_spacing(table.facts)
    except TableError as error:  # which only matters without times
        found.notes.append(f"{error}.")
    found.interrupted = table.interrupted
    found.multiplier = stated_fact(table.facts, MULTIPLIER_FACTS)
    rising = _rising_column(table.columns)
    block, value, after = 0, 0, True
    for column in table.columns:
        name = plain_name(name_and_unit(column.heading, ())[0])
        unnamed = rising is None or column.number < rising.number
        counter = name[:1] == "x" or (name in SAMPLE_NUMBERS and (name or unnamed))
        if not unit_of(column.unit) and (
            plain_name(column.unit) in SAMPLE_NUMBERS - {""}
            or (counter and _counts_samples(column))
        ):
            found.notes.append(f"column {column.number} numbers the samples and is not used.")
            continue
        time = column.dates or is_time(column.heading, column.unit) or column is rising
        if time and not after:
            block += 1
        after = time
        unit = column.unit or (
            stated_fact(table.facts, TIME_UNIT_FACTS)
            if time
            else stated_fact(table.facts, VALUE_UNIT_FACTS, value)
        )
        value += not time
        found.series.append(
            Series(
                column.heading,
                "s" if column.dates else unit,
                column.values,
                column.number,
                str(block + 1),
                is_time=time,
            )
        )
    times = [one.is_time for one in found.series]
    if found.spacing is None and times and times[-1] and not times[0]:  # times behind values
        found.series = [one._replace(group="") for one in found.series]
    return found


def _counts_samples(column: TextColumn) -> bool:
    """Whether each value of a column is the one before it plus one."""
    return len(column.values) > 1 and bool(np.all(np.diff(column.values) == 1.0))


def _rising_column(columns: list[TextColumn]) -> TextColumn | None:
    """Return the first column of a table without names, or that behind numbers of samples, if it
    rises as times do; else None."""
    if len(columns) < 2 or any(column.heading for column in columns):
        return None
    if len(columns) > 2 and _counts_samples(columns[0]):
        return _rising_column(columns[1:])
    first = columns[0]
    rises = np.all(np.diff(first.values[np.isfinite(first.values)]) > 0.0)
    return first if rises and (first.unit or not _counts_samples(first)) else None
