"""Latencies by sample (`controller.latency_trace`): from a file, or drawn from a distribution."""

import math
import re
from pathlib import Path
from typing import Any, cast

import numpy as np

from hertzloop.scenes.errors import quoted_path, shortened, shown
from hertzloop.text_files import text_of

# Numbers that a distribution of latencies must have, with their least value.
_DRAWN = {"median_us": 0.0, "sigma": 0.0, "autocorrelation": 0.0}
_SAMPLES = 4096
_TRACE = 13  # random stream of these latencies


def draw_latencies(table: dict[str, Any]) -> list[float]:
    """Latencies that are log-normal, with an autocorrelation from one sample to the next.

    The logarithms form a first-order autoregressive process. `least_us` is added, `seed` and
    `samples` are 1 and 4096 if left out.
    """
    said = "controller.latency_trace"
    known = {*_DRAWN, "least_us", "seed", "samples"}
    if unknown := sorted(set(table) - known):
        raise ValueError(f"{said}.{unknown[0]}: unknown key. Use {', '.join(sorted(known))}")
    numbers: dict[str, Any] = {"least_us": 0.0, "seed": 1, "samples": _SAMPLES} | table
    for name, least in {**_DRAWN, "least_us": 0.0, "seed": 0, "samples": 1}.items():
        value = numbers.get(name)
        whole = name in ("seed", "samples")
        good = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
        most = {"autocorrelation": 1.0 - 1e-9, "samples": _MOST_LATENCIES}.get(name, 1e6)
        if not good or not least <= cast(float, value) <= most:
            raise ValueError(
                f"{said}.{name} = {shown(value)}: must be a {'whole ' if whole else ''}number from "
                f"{least:g} to {most:g}"
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
_IN_BRACKETS = re.compile(r"(.*?)\s*[\[(]\s*(\S*?)\s*[\])]")


def read_latencies(path: Path) -> list[float]:
    """Latencies of a text table or a recording, us.

    A table has one column, or one called latency; its heading may name a unit of time, as in
    `latency_ms` or `latency [ns]`, and us is meant without one. Numbers may have a decimal comma
    if that is not the separator of columns. A recording (.mcap) of a paced run gives those that it
    had.

    Raises:
        ValueError: there is no latency in each line, or the file can mean two things.
    """
    said = f"controller.latency_trace = {quoted_path(path)}"
    try:
        if path.suffix == ".mcap":
            # 0.03 s of every start, for traces of this kind alone.
            from hertzloop.recordings.latencies import latencies_of
            from hertzloop.recordings.reader import read

            found = [float(x) for x in latencies_of(read(path))]
        else:
            found = _column(text_of(path.read_bytes()))
    except (ValueError, OSError, RuntimeError) as error:
        raise ValueError(f"{said}: {shortened(str(error))}") from error
    if not 1 <= len(found) <= _MOST_LATENCIES:
        raise ValueError(f"{said}: has {len(found)} latencies. Give 1 to {_MOST_LATENCIES}")
    return found


def _column(text: str) -> list[float]:
    """The latencies in a text table, us."""
    lines = [line.strip() for line in text.splitlines()]
    lines = [line for line in lines if line and not line.startswith("#")]
    separator = next((mark for mark in (";", "\t") if mark in text), None)
    headed = bool(lines) and not _is_number(lines[0].split(separator or ",")[0])
    if separator is None and lines and "," in (lines[0] if headed else "".join(lines)):
        if not headed:
            raise ValueError(
                "a comma may separate columns or begin the decimals. Give a heading: latency_us "
                "for one column, or one for each column"
            )
        separator = ","
    rows = [[cell.strip(' "') for cell in line.split(separator)] for line in lines]
    headings = rows.pop(0) if headed else [""] * len(rows[0] if rows else [""])
    names = [_name_and_unit(heading) for heading in headings]
    chosen = [at for at, (name, _) in enumerate(names) if name.lower() == "latency"]
    if len(names) > 1 and len(chosen) != 1:
        raise ValueError("has several columns. Call one of them latency_us")
    at = chosen[0] if len(names) > 1 else 0
    cells = [row[at] if at < len(row) else "" for row in rows]
    if any("," in cell for cell in cells) and any("." in cell for cell in cells):
        raise ValueError("has numbers with a decimal comma and with a decimal point. Use one")
    for number, cell in enumerate(cells, 1):
        if not _is_number(cell):
            raise ValueError(
                f"row {number}: {shown(cell)} is no number. Give a latency in every line"
            )
    return [round(names[at][1] * float(cell.replace(",", ".")), 9) for cell in cells]


def _name_and_unit(heading: str) -> tuple[str, float]:
    """The name in a heading, and its unit in us."""
    if found := _IN_BRACKETS.fullmatch(heading):
        name, unit = found.groups()
    else:
        name, _, unit = heading.rpartition("_")
        if unit not in _IN_US and name.lower() != "latency":
            name, unit = heading, ""
    if unit and unit not in _IN_US:
        raise ValueError(f"{shown(unit)} is no unit of time. Use latency_us")
    return name, _IN_US[unit or "us"]


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell.replace(",", ".")))
    except ValueError:
        return False
