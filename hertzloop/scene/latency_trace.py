"""Latencies by sample (`controller.latency_trace`): from a file, or drawn from a distribution."""

import math
import re
from pathlib import Path
from typing import Any, cast

import numpy as np

from hertzloop.common.text_files import text_of
from hertzloop.scene.errors import quoted_path, shortened, shown

# Numbers that a distribution of latencies must have, with their least value.
_DRAWN = {"median_us": 0.0, "sigma": 0.0, "autocorrelation": 0.0}
_SAMPLES = 4096
_TRACE = 13  # random stream of these latencies


def draw_latencies(table: dict[str, Any]) -> list[float]:
    """Latencies that are log-normal, with an autocorrelation from one sample to the next.

    The logarithms form a first-order autoregressive process. `least_us` is added, `seed` and
    `samples` are 1 and 4096 if left out.
    """
    where = "controller.latency_trace"
    known = {*_DRAWN, "least_us", "seed", "samples"}
    if unknown := sorted(set(table) - known):
        raise ValueError(f"{where}.{unknown[0]}: unknown key. Use {', '.join(sorted(known))}")
    numbers: dict[str, Any] = {"least_us": 0.0, "seed": 1, "samples": _SAMPLES} | table
    for name, least in {**_DRAWN, "least_us": 0.0, "seed": 0, "samples": 1}.items():
        value = numbers.get(name)
        whole = name in ("seed", "samples")
        good = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
        most = {"autocorrelation": 1.0 - 1e-9, "samples": _MOST_LATENCIES}.get(name, 1e6)
        if not good or not least <= cast(float, value) <= most:
            raise ValueError(
                f"{where}.{name} = {shown(value)}: must be a {'whole ' if whole else ''}number "
                f"from {least:g} to {most:g}"
            )
    normal = np.random.Generator(np.random.Philox(key=[numbers["seed"], _TRACE])).standard_normal(
        numbers["samples"]
    )
    keep, walk = numbers["autocorrelation"], float(normal[0])
    found = [walk]
    for one in normal[1:]:
        walk = keep * walk + math.sqrt(1.0 - keep * keep) * float(one)
        found.append(walk)
    logs = numbers["sigma"] * np.array(found)
    return [round(float(x), 3) for x in numbers["least_us"] + numbers["median_us"] * np.exp(logs)]


_MOST_LATENCIES = 1_000_000
_IN_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "µs": 1.0, "μs": 1.0, "ns": 1e-3}
# A unit in brackets, or after a slash or an underscore.
_HEADING = re.compile(r"(.+?)\s*(?:[\[(]\s*(\S*?)\s*[\])]|/\s*(\S+)|_(\S+?))?")
_NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?\d{1,3},\d{3}")


def read_latencies(path: Path) -> list[float]:
    """Latencies of a text table or a recording, us.

    A table has one column, or one called latency. Its heading may name a unit of time, as in
    `latency_ms` or `latency [ns]`; us is meant without one. Columns are separated by a semicolon, a
    tab or a comma, as in the heading. Numbers may have a decimal comma otherwise. A recording
    (.mcap) of a paced run gives the latencies that it had.

    Raises:
        ValueError: there is no latency in each line, or the file can mean two things.
    """
    where = f"controller.latency_trace = {quoted_path(path)}"
    try:
        if path.suffix == ".mcap":
            # 0.03 s of every start, for traces of this kind alone.
            from hertzloop.recordings.latencies import latencies_of
            from hertzloop.recordings.reader import read

            found = [float(x) for x in latencies_of(read(path))]
        else:
            found = _column(text_of(path.read_bytes()))
    except (ValueError, OSError, RuntimeError) as error:
        raise ValueError(f"{where}: {shortened(str(error))}") from error
    if not 1 <= len(found) <= _MOST_LATENCIES:
        raise ValueError(f"{where}: has {len(found)} latencies. Give 1 to {_MOST_LATENCIES}")
    return found


def _column(text: str) -> list[float]:
    """The latencies in a text table, us."""
    numbered = [(at, line.strip()) for at, line in enumerate(text.splitlines(), 1)]
    lines = [(at, line) for at, line in numbered if line and not line.startswith("#")]
    if not lines:
        return []
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
    chosen = 0
    if len(headings) > 1:
        named = [i for i, heading in enumerate(headings) if _split(heading)[0] == "latency"]
        if len(named) != 1:
            raise ValueError("has several columns. Call one of them latency_us")
        chosen = named[0]
    for at, row in rows:
        if len(row) != len(headings):
            raise ValueError(f"line {at}: has {len(row)} columns, not {len(headings)}")
        if not _NUMBER.fullmatch(row[chosen]):
            raise ValueError(
                f"line {at}: {shown(row[chosen])} is no number. Give a latency in every line"
            )
    cells = [row[chosen] for _, row in rows]
    _check_commas(cells, headed)
    in_us = _unit_us(headings[chosen])
    return [round(in_us * float(cell.replace(",", ".")), 9) for cell in cells]


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
    if found[4] and unit not in _IN_US and name.lower() != "latency":
        return heading.lower(), ""  # an underscore within the name
    return name.lower(), unit


def _unit_us(heading: str) -> float:
    unit = _split(heading)[1]
    if unit and unit not in _IN_US:
        raise ValueError(f"{shown(unit)} is no unit of time. Use latency_us")
    return _IN_US[unit or "us"]
