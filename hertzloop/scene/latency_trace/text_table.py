"""Latencies of a text table: a column of them, or of the time stamps of samples and commands."""

import re
from decimal import Decimal
from typing import NamedTuple

from hertzloop.scene.errors import shown
from hertzloop.scene.latency_trace.trace_file import IN_US, Latencies, TraceFile

# A unit in brackets, or after a slash or an underscore.
_HEADING = re.compile(r"(.+?)\s*(?:[\[(]\s*(\S*?)\s*[\])]|/\s*(\S+)|_(\S+?))?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")  # a comma that may separate them, as in 1,200
_NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?")


def read_table(text: str, about: TraceFile) -> Latencies:
    """Return the latencies in a text table.

    The table has one column, or one called latency, or the columns sample and command with time
    stamps, or columns that `about` names. A heading may name a unit of time, as in `latency_ms` or
    `latency [ns]`; us is meant without one. Columns are separated by a semicolon, a tab or a comma,
    as in the heading. Numbers may have a decimal comma otherwise.

    Raises:
        ValueError: there is no latency in each line, or the table can mean two things.
    """
    about.refuse("a text table", "thread")
    table = _table(text)
    if not table.rows:
        return Latencies([])
    times = _time_columns(table.headings, about)
    if times is None:
        chosen = _latency_column(table.headings, about)
        return Latencies([float(latency) for latency in _column(table, chosen, about)])
    samples, commands = (_column(table, chosen, about) for chosen in times)
    return Latencies([float(b - a) for a, b in zip(samples, commands, strict=True)])


class _Table(NamedTuple):
    """Headings, empty texts without any; the cells of each line, with its number; whether there are
    headings."""

    headings: list[str]
    rows: list[tuple[int, list[str]]]
    headed: bool


def _table(text: str) -> _Table:
    """Return the cells of a text. Raises ValueError."""
    numbered = [(at, line.strip()) for at, line in enumerate(text.splitlines(), 1)]
    lines = [(at, line) for at, line in numbered if line and not line.startswith("#")]
    if not lines:
        return _Table([], [], False)
    first = lines[0][1]
    headed = re.match(r"[\d+.,;-]", first) is None
    separator = next((mark for mark in (";", "\t", ",") if mark in first), None)
    if separator == "," and not headed:
        separator = None  # and refused, as a comma there can mean two things
    rows = [
        (at, [cell.strip(' "') for cell in line.split(separator)] if separator else [line])
        for at, line in lines
    ]
    headings = rows.pop(0)[1] if headed else [""] * len(rows[0][1])
    for at, row in rows:
        if len(row) != len(headings):
            raise ValueError(f"line {at}: has {len(row)} columns, not {len(headings)}")
    return _Table(headings, rows, headed)


def _latency_column(headings: list[str], about: TraceFile) -> int:
    if about.column is not None:
        return _named(headings, about.column)
    named = [i for i, heading in enumerate(headings) if _split(heading)[0] == "latency"]
    if len(headings) > 1 and len(named) != 1:
        raise ValueError(
            "has several columns. Call one of them latency_us, or choose one with latency_trace = "
            "{ file = ..., column = ... }"
        )
    return named[0] if named else 0


def _time_columns(headings: list[str], about: TraceFile) -> tuple[int, int] | None:
    """Return the columns of time stamps of samples and commands, None for a table of latencies."""
    if about.sample is not None and about.command is not None:
        return _named(headings, about.sample), _named(headings, about.command)
    names = [_split(heading)[0] for heading in headings]
    if about.column is None and "latency" not in names and {"sample", "command"} <= set(names):
        return names.index("sample"), names.index("command")
    return None


def _named(headings: list[str], name: str) -> int:
    found = [i for i, heading in enumerate(headings) if name in (heading, _split(heading)[0])]
    if len(found) != 1:
        raise ValueError(
            f"{len(found)} columns are called {shown(name)}. The columns are "
            f"{', '.join(map(shown, headings))}"
        )
    return found[0]


def _column(table: _Table, chosen: int, about: TraceFile) -> list[Decimal]:
    """Return the numbers of a column, us. They are decimals, since a float of the seconds since
    1970 ends at 0.2 us. Raises ValueError."""
    for at, row in table.rows:
        if not _NUMBER.fullmatch(row[chosen]):
            raise ValueError(
                f"line {at}: {shown(row[chosen])} is no number. Give a latency in every line"
            )
    cells = [row[chosen] for _, row in table.rows]
    _check_commas(cells, table.headed)
    in_us = Decimal(str(_unit_us(table.headings[chosen], about.unit)))
    return [in_us * Decimal(cell.replace(",", ".")) for cell in cells]


def _check_commas(cells: list[str], headed: bool) -> None:
    """Refuse commas in numbers that need not be decimal ones. Raises ValueError."""
    commas = [cell for cell in cells if "," in cell]
    if not commas:
        return
    if not headed:
        raise ValueError(
            f"{shown(commas[0])}: the comma may separate columns or begin the decimals. Give a "
            "heading: latency_us for one column, or one for each column"
        )
    if any("." in cell for cell in cells):
        raise ValueError("has numbers with a decimal comma and with a decimal point. Use one")
    if all(_THOUSANDS.fullmatch(cell) for cell in commas):
        raise ValueError(
            f"{shown(commas[0])}: the comma may begin the decimals or separate thousands. Use a "
            "decimal point, and nothing between thousands"
        )


def _split(heading: str) -> tuple[str, str]:
    """The name in a heading, in small letters, and what stands in the place of its unit."""
    found = _HEADING.fullmatch(heading)
    if found is None:
        return heading.lower(), ""
    name, *units = found.groups()
    unit = next((unit for unit in units if unit), "")
    if found[4] and unit not in IN_US and name.lower() != "latency":
        return heading.lower(), ""  # an underscore within the name
    return name.lower(), unit


def _unit_us(heading: str, told: str | None) -> float:
    """Return how many us the unit of a column is. Raises ValueError."""
    unit = _split(heading)[1]
    if told is not None and unit in IN_US and IN_US[unit] != IN_US[told]:
        raise ValueError(f"{shown(heading)} names another unit than unit = {shown(told)}")
    if told is None and unit and unit not in IN_US:
        raise ValueError(f"{shown(unit)} is no unit of time. Use latency_us")
    return IN_US[told or unit or "us"]
