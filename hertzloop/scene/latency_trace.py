"""Latencies of a file: one column, two columns of time stamps, a histogram of cyclictest, or a
recording of a paced run.

A heading may name a unit of time, as in `latency_ms` or `latency [ns]`; without one it is us.
Columns are separated by a semicolon, a tab or a comma; numbers have a decimal point.

Source of the histogram: rt-tests, `man cyclictest -h`. A line is a latency and, for each thread,
how many cycles had it, in microseconds, or in nanoseconds with `-N`, which the output does not
state.
"""

import re
from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError

from hertzloop.common.missing_files import why_unreadable
from hertzloop.common.text_files import text_of
from hertzloop.scene.errors import quoted_path, sentence, shortened, shown
from hertzloop.scene.tables import SceneTable

MOST_LATENCIES = 1_000_000
_IN_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "µs": 1.0, "μs": 1.0, "ns": 1e-3}
_HEADING = re.compile(r"(.+?)(?:\s*[\[(]\s*(\S*?)\s*[\])]|_([^\W_]+))?")  # name, unit
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_BIN = re.compile(r"\d{1,15}(\s+\d{1,15})+\s*")
_OVERFLOWS = re.compile(r"#\s*Histogram Overflows:((?:\s*\d+)+)", re.IGNORECASE)
_SURELY_US = 100.0  # below this median a latency is not in ns: no timer wakes within 0.1 us
_ORDER_SEED = 14  # of the order in which the latencies of a histogram are drawn


class TraceFile(SceneTable):
    """A file of latencies, and what its content leaves open.

    Attributes:
        file: The file.
        column: Heading of the column of latencies in a text table.
        sample: Heading of the column with the time stamps of samples.
        command: Heading of the column with the time stamps of commands.
        unit: Unit of the numbers, if the file does not state it: s, ms, us or ns.
        thread: Thread of a histogram of cyclictest.
        offset_us: Added to every latency, us: by how much the clock of the samples is ahead of the
            clock of the commands.
    """

    file: Path
    column: str | None = None
    sample: str | None = None
    command: str | None = None
    unit: Literal[(*_IN_US,)] | None = None  # type: ignore[valid-type]
    thread: int | None = None
    offset_us: float = 0.0

    def refuse(self, what: str, *names: str) -> None:
        """Raise ValueError for a given key that has no meaning for `what`."""
        for name in names:
            if getattr(self, name) is not None:
                raise ValueError(f"{name}: has no meaning for {what}. Leave it out")


def latencies_of_file(table: Mapping[str, Any], use: object, folder: Path) -> list[float]:
    """Return the latencies of the file that a table of a scene names, us, in the order of time.

    Args:
        table: The table; see `TraceFile`.
        use: `controller.latency_trace_use` of the scene; of a histogram "resample".
        folder: Folder of the scene.

    Raises:
        ValueError: the file has no latencies, or can mean two things.
    """
    try:
        about = TraceFile.model_validate(table)
    except ValidationError as error:
        raise ValueError(sentence(error, TraceFile, ("controller", "latency_trace"))) from error
    where = f"controller.latency_trace = {quoted_path(folder / about.file)}"
    try:
        values = [round(us + about.offset_us, 9) for us in _read(folder / about.file, about, use)]
        if values and min(values) < 0.0:
            raise ValueError(
                f"a command is {-min(values):.6g} us earlier than its sample, as their clocks "
                "differ. Align them with latency_trace = { file = ..., offset_us = ... }"
            )
    except OSError as error:
        why = why_unreadable(folder / about.file, error, "Give the path of a trace of latencies.")
        raise ValueError(f"{where}: cannot be read: {why}") from error
    except (ValueError, RuntimeError) as error:
        raise ValueError(f"{where}: {shortened(str(error))}") from error
    if not 1 <= len(values) <= MOST_LATENCIES:
        raise ValueError(f"{where}: has {len(values)} latencies. Give 1 to {MOST_LATENCIES}")
    return values


def _read(path: Path, about: TraceFile, use: object) -> list[float]:
    if path.suffix == ".mcap":
        return _of_recording(path, about)
    lines = [line.strip() for line in text_of(path.read_bytes()).splitlines()]
    if any(line.startswith("# Histogram") for line in lines):
        return _of_histogram([line for line in lines if line], about, use)
    return _of_table(lines, about)


def _of_recording(path: Path, about: TraceFile) -> list[float]:
    # These modules add 0.03 s to every start, so they are loaded for traces of this kind alone.
    from hertzloop.recordings.latencies import latencies_of
    from hertzloop.recordings.reader import holds_a_run, read

    if not holds_a_run(path):
        raise ValueError("is not a recording of a run. Give a recording of a paced run, or a table")
    about.refuse("a recording of a run", "column", "sample", "command", "unit", "thread")
    return [float(value) for value in latencies_of(read(path))]


def _of_table(lines: list[str], about: TraceFile) -> list[float]:
    """Return the latencies of the lines of a table: its one column, or the one called latency, or
    command less sample, or what `about` names."""
    about.refuse("a text table", "thread")
    numbered = [(at, line) for at, line in enumerate(lines, 1) if line and line[0] != "#"]
    if not numbered:
        return []
    first = numbered[0][1]
    headed = re.match(r"[\d+.,;-]", first) is None
    mark = next((mark for mark in ";\t," if headed and mark in first), None)
    rows = [
        (at, [cell.strip(' "') for cell in (line.split(mark) if mark else [line])])
        for at, line in numbered
    ]
    headings = rows.pop(0)[1] if headed else [""]
    for at, row in rows:
        if len(row) != len(headings):
            raise ValueError(f"line {at}: has {len(row)} columns, not {len(headings)}")
    columns = []
    for chosen in _chosen(headings, about):
        # Decimals, since a float of the seconds since 1970 ends at 0.2 us.
        unit_us = Decimal(str(_unit_us(headings[chosen], about.unit)))
        for at, row in rows:
            if not _NUMBER.fullmatch(row[chosen]):
                raise ValueError(
                    f"line {at}: {shown(row[chosen])} is not a number. Give a latency in every "
                    "line, with a decimal point, and a heading if there are several columns"
                )
        columns.append([unit_us * Decimal(row[chosen]) for _, row in rows])
    if len(columns) == 1:
        return [float(value) for value in columns[0]]
    return [float(command - sample) for sample, command in zip(*columns, strict=True)]


def _chosen(headings: list[str], about: TraceFile) -> list[int]:
    """The column of latencies, or those of the time stamps of samples and commands."""
    names = [_name_and_unit(heading)[0] for heading in headings]
    wanted = [name for name in (about.sample, about.command) if name is not None]
    if len(wanted) == 1:
        raise ValueError("sample and command belong together. Give both or none")
    if about.column is not None:
        wanted = [about.column]
    elif not wanted and {"sample", "command"} <= {*names} and "latency" not in names:
        wanted = ["sample", "command"]
    elif not wanted and "latency" in names:
        wanted = ["latency"]
    elif not wanted and len(headings) > 1:
        raise ValueError(
            "has several columns. Call one of them latency_us, or choose one with latency_trace = "
            "{ file = ..., column = ... }"
        )
    chosen = [[i for i, n in enumerate(names) if name in (headings[i], n)] for name in wanted]
    for name, found in zip(wanted, chosen, strict=True):
        if len(found) != 1:
            raise ValueError(
                f"{len(found)} columns are called {shown(name)}. The columns are "
                f"{', '.join(map(shown, headings))}"
            )
    return [found[0] for found in chosen] or [0]


def _name_and_unit(heading: str) -> tuple[str, str]:
    """The name in a heading, in small letters, and what stands in the place of its unit."""
    found = _HEADING.fullmatch(heading.lower())
    if found is None or (found[3] and found[3] not in _IN_US and found[1] != "latency"):
        return heading.lower(), ""  # an underscore within the name
    return found[1], found[2] or found[3] or ""


def _unit_us(heading: str, told: str | None) -> float:
    """Return how many us the unit of a column is."""
    unit = _name_and_unit(heading)[1]
    if told is not None and unit in _IN_US and _IN_US[unit] != _IN_US[told]:
        raise ValueError(f"{shown(heading)} names another unit than unit = {shown(told)}")
    if told is None and unit and unit not in _IN_US:
        raise ValueError(f"{shown(unit)} is no unit of time. Use latency_us")
    return _IN_US[told or unit or "us"]


def _of_histogram(lines: list[str], about: TraceFile, use: object) -> list[float]:
    """Return as many latencies as cycles, at most `MOST_LATENCIES`, in a random order.

    Of more cycles every latency has its share, and at least one.
    """
    about.refuse("a histogram of cyclictest", "column", "sample", "command")
    numbers = [line for line in lines if line[0].isdigit()]
    rows = [line.split() for line in numbers if _BIN.fullmatch(line)]
    overflows = next((found[1].split() for found in map(_OVERFLOWS.match, lines) if found), [])
    if len(rows) < len(numbers) or {len(row) - 1 for row in rows} != {len(overflows)}:
        raise ValueError(
            "the histogram is cut off or damaged: a latency does not have as many counts as the "
            "line Histogram Overflows"
        )
    threads, thread = list(range(len(overflows))), about.thread or 0
    if about.thread is None and len(threads) > 1:
        raise ValueError(
            f"has the threads {', '.join(map(str, threads))}. Choose one with latency_trace = "
            "{ file = ..., thread = 0 }"
        )
    if thread not in threads:
        raise ValueError(f"thread {thread}: is not in the file. Use one of {threads}")
    if lost := int(overflows[thread]):
        raise ValueError(
            f"{lost} cycles are above the histogram, by an unknown latency. Repeat cyclictest with "
            "a larger -h"
        )
    if use != "resample":
        raise ValueError(
            "is a histogram, which does not say in what order latencies come. Set "
            'controller.latency_trace_use = "resample" to draw them at random'
        )
    bins = np.array(rows, dtype=float)
    latency, count = bins[:, 0], bins[:, 1 + thread]
    share = max(1.0, count.sum() / max(1, MOST_LATENCIES - len(count)))
    count = np.where(count > 0.0, np.maximum(1.0, np.round(count / share)), 0.0).astype(int)
    values = np.repeat(latency, count)
    if about.unit is None and values.size and np.median(values) >= _SURELY_US:
        raise ValueError(
            f"the median {np.median(values):g} may be us, or ns of cyclictest -N. Choose one with "
            'latency_trace = { file = ..., unit = "us" }'
        )
    values *= _IN_US[about.unit or "us"]
    return [float(value) for value in np.random.default_rng(_ORDER_SEED).permutation(values)]
