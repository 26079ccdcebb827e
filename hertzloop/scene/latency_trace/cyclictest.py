"""Latencies of cyclictest: its histogram (`-h`).

Source: rt-tests, `man cyclictest`. A line is a latency and, for each thread, how many cycles had
it, in microseconds, or in nanoseconds with `-N`, which the output does not state.
"""

import re

import numpy as np

from hertzloop.scene.latency_trace.trace_file import IN_US, MOST_LATENCIES, Latencies, TraceFile

_BIN = re.compile(r"\d{1,15}(\s+\d{1,15})+\s*")
_OVERFLOWS = re.compile(r"#\s*Histogram Overflows:((?:\s*\d+)+)", re.IGNORECASE)
_SURELY_US = 100.0  # below this median a latency is not in ns: no timer wakes within 0.1 us
_ORDER_SEED = 14  # of the order in which the latencies of a histogram are drawn


def is_histogram(lines: list[str]) -> bool:
    """Whether lines are a histogram."""
    return any(line.startswith("# Histogram") for line in lines)


def read_histogram(lines: list[str], about: TraceFile) -> Latencies:
    """Return as many latencies as cycles, at most `MOST_LATENCIES`, in a random order.

    Of more cycles every latency has its share, and at least one. Raises ValueError.
    """
    about.refuse("a histogram of cyclictest", "column", "sample", "command")
    numbers = [line for line in lines if line[0].isdigit()]
    rows = [line.split() for line in numbers if _BIN.fullmatch(line)]
    overflows = next((found[1].split() for found in map(_OVERFLOWS.match, lines) if found), [])
    counts = {len(row) - 1 for row in rows}
    if len(rows) < len(numbers) or counts != {len(overflows)}:
        raise ValueError(
            "the histogram is cut off or damaged: a latency does not have as many counts as the "
            "line Histogram Overflows"
        )
    thread = _thread(list(range(len(overflows))), about)
    if lost := int(overflows[thread]):
        raise ValueError(
            f"{lost} cycles are above the histogram, by an unknown latency. Repeat cyclictest with "
            "a larger -h"
        )
    bins = np.array(rows, dtype=float)
    latency, count = bins[:, 0], bins[:, 1 + thread]
    if not count.any():
        return Latencies([], ordered=False)
    share = max(1.0, count.sum() / max(1, MOST_LATENCIES - len(count)))
    count = np.where(count > 0.0, np.maximum(1.0, np.round(count / share)), 0.0).astype(int)
    values = np.repeat(latency, count)
    values *= _unit(float(np.median(values)), about)
    return Latencies(np.random.default_rng(_ORDER_SEED).permutation(values).tolist(), False)


def _thread(threads: list[int], about: TraceFile) -> int:
    """Return the thread to read. Raises ValueError."""
    if about.thread is None and len(threads) > 1:
        raise ValueError(
            f"has the threads {', '.join(map(str, threads))}. Choose one with latency_trace = "
            "{ file = ..., thread = 0 }"
        )
    thread = threads[0] if about.thread is None else about.thread
    if thread not in threads:
        raise ValueError(f"thread {thread}: is not in the file. Use one of {threads}")
    return thread


def _unit(median: float, about: TraceFile) -> float:
    """Return how many us the unit of the numbers is. Raises ValueError."""
    if about.unit is None and median >= _SURELY_US:
        raise ValueError(
            f"the median {median:g} may be us, or ns of cyclictest -N. Choose one with "
            'latency_trace = { file = ..., unit = "us" }'
        )
    return IN_US[about.unit or "us"]
