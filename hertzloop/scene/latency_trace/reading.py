"""Read a file of latencies, in any of the formats that are known."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hertzloop.common.missing_files import why_unreadable
from hertzloop.common.text_files import text_of
from hertzloop.scene.errors import quoted_path, shortened
from hertzloop.scene.latency_trace import cyclictest
from hertzloop.scene.latency_trace.text_table import read_table
from hertzloop.scene.latency_trace.trace_file import MOST_LATENCIES, Latencies, TraceFile


def read_latencies(about: TraceFile) -> Latencies:
    """Return the latencies of a file.

    A paced recording has its own. In another MCAP file they are log time less publish time of a
    topic. A text file is a list or a histogram of cyclictest, the output of `ros2 topic delay`, or
    a table.

    Raises:
        ValueError: the file has no latencies, or can mean two things.
    """
    where = f"controller.latency_trace = {quoted_path(about.file)}"
    try:
        values, ordered = _read(about)
        values = [round(value + about.offset_us, 9) for value in values]
        if values and min(values) < 0.0:
            raise ValueError(
                f"a command is {-min(values):.6g} us earlier than its sample, as their clocks "
                "differ. Align them with latency_trace = { file = ..., offset_us = ... }"
            )
    except OSError as error:
        remedy = "Give the path of a trace of latencies."
        why = why_unreadable(about.file, error, remedy)
        raise ValueError(f"{where}: cannot be read: {why}") from error
    except (ValueError, RuntimeError) as error:
        raise ValueError(f"{where}: {shortened(str(error))}") from error
    if not 1 <= len(values) <= MOST_LATENCIES:
        raise ValueError(f"{where}: has {len(values)} latencies. Give 1 to {MOST_LATENCIES}")
    return Latencies(values, ordered)


def _read(about: TraceFile) -> Latencies:
    if about.file.suffix == ".mcap":
        return _read_mcap(about)
    text = text_of(about.file.read_bytes())
    lines = [line for line in text.splitlines() if line.strip()]
    if not lines:
        return Latencies([])
    if cyclictest.is_histogram(lines):
        return cyclictest.read_histogram(lines, about)
    return read_table(text, about)


def _read_mcap(about: TraceFile) -> Latencies:
    # These modules add 0.03 s to every start, so they are loaded for traces of this kind alone.
    from hertzloop.recordings.latencies import latencies_of
    from hertzloop.recordings.reader import holds_a_run, read

    if not holds_a_run(about.file):
        raise ValueError("is not a recording of a run. Give a recording of a paced run, or a table")
    about.refuse("a recording of a run", "column", "sample", "command", "unit", "thread")
    return Latencies([float(value) for value in latencies_of(read(about.file))])


def latencies_of_file(table: Mapping[str, Any], use: object, folder: Path) -> list[float]:
    """Return the latencies of the file that a table of a scene names, us.

    Args:
        table: The table; see `TraceFile`.
        use: `controller.latency_trace_use` of the scene.
        folder: Folder of the scene.

    Raises:
        ValueError: as `read_latencies`; or the file is a histogram, and `use` is not "resample".
    """
    values, ordered = read_latencies(TraceFile.from_table(table, folder))
    if not ordered and use != "resample":
        raise ValueError(
            "controller.latency_trace: is a histogram, which does not say in what order latencies "
            'come. Set controller.latency_trace_use = "resample" to draw them at random'
        )
    return values
