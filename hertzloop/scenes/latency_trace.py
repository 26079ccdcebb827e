"""Latencies by sample (`controller.latency_trace`): from a file, or drawn from a distribution."""

import math
from pathlib import Path
from typing import Any, cast

import numpy as np

from hertzloop.scenes.errors import quoted_path, shortened, shown
from hertzloop.text_tables import TableError, read_table
from hertzloop.units import name_and_unit, plain_name, unit_of

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


_LATENCY = "latency"  # name of the column of a trace that has several
_MOST_LATENCIES = 1_000_000


def read_latencies(path: Path) -> list[float]:
    """Latencies of a text table, us: its only column, or the one called latency, in the unit of its
    heading, or else in us. Of a recording (.mcap) of a paced run, those that it had."""
    said = f"controller.latency_trace = {quoted_path(path)}"
    if path.suffix == ".mcap":
        # 0.03 s of every start, for traces of this kind alone.
        from hertzloop.recordings.latencies import latencies_of
        from hertzloop.recordings.reader import read

        try:
            return [float(x) for x in latencies_of(read(path))]
        except (ValueError, OSError, RuntimeError) as error:
            raise ValueError(f"{said}: {shortened(str(error))}") from error
    try:
        table = read_table(path, (_LATENCY,))
    except (OSError, TableError) as error:
        raise ValueError(f"{said}: cannot be read: {shortened(str(error))}") from error
    split = [(name_and_unit(column.heading, (_LATENCY,)), column) for column in table.columns]
    if len(split) > 1:
        split = [one for one in split if plain_name(one[0][0]) == _LATENCY]
    if table.columns and len(split) != 1:
        raise ValueError(f"{said}: has several columns. Call one of them latency_us")
    found: list[float] = []
    for (_, stated), column in split:
        unit = unit_of(stated or column.unit or "us")
        if unit is None or unit.si != "s":
            raise ValueError(
                f"{said}: '{stated or column.unit}' is no unit of time. Use latency_us"
            )
        found = [round(1e6 * unit.size * float(value), 9) for value in column.values]
        gaps = [i for i, value in enumerate(found) if not math.isfinite(value)]
        if gaps or table.notes:
            where = f"row {gaps[0] + 1} of the numbers has no number" if gaps else table.notes[0]
            raise ValueError(f"{said}: {where.rstrip('.')}. Give a latency in every line")
    if not 1 <= len(found) <= _MOST_LATENCIES:
        raise ValueError(f"{said}: has {len(found)} latencies. Give 1 to {_MOST_LATENCIES}")
    return found
