"""The latencies at which a loop is stable: the limit from 0 on, and all stable windows."""

import math

import numpy as np

from hertzloop.studies.margin.loop import PolyphaseLoop
from hertzloop.studies.margin.table import NyquistTable

_SCANNED = 1 << 16  # largest latency, steps, that is looked at for the limit
_WINDOWS = 2000  # latencies, steps, up to which stable windows are listed


def latency_limit(loops: PolyphaseLoop) -> int | None:
    """Return the largest latency, steps, up to which the loop is stable at every latency from 0 on;
    -1 if at none, None without limit."""
    if not any(loop.table.arcs or loop.table.outside for loop in loops.every):
        return None
    first, size = 0, 256
    while first < _SCANNED:
        bad = np.flatnonzero(loops.unstable(np.arange(first, first + size)))
        if len(bad):
            return first + int(bad[0]) - 1
        first += size
        size *= 2
    return None


def _ends(table: NyquistTable) -> tuple[np.ndarray, np.ndarray]:
    angles, phases = [], []
    for arc in table.arcs:
        for angle, phase in ((arc.start, arc.phase_start), (arc.end, arc.phase_end)):
            if 0.0 < angle < math.pi:
                angles.append(angle)
                phases.append(phase)
    return np.array(angles), np.array(phases)


def crossing_after(loops: PolyphaseLoop, latency: int, back: bool = False) -> tuple[float, float]:
    """Return where stability ends between `latency` and the next one, or the one before if `back`.

    Returns:
        The latency, steps, and the angle of the pole on the unit circle.
    """
    table, lead = loops.every[0].table, loops.lead
    angles, phases = _ends(table)
    if not len(angles):
        return float(latency), math.pi
    low = latency - 1 if back else latency
    # A crossing lies where phase - D angle is an odd multiple of pi.
    first = np.ceil((phases - (low + 1 + lead) * angles + math.pi) / (2.0 * math.pi))
    last = np.floor((phases - (low + lead) * angles + math.pi) / (2.0 * math.pi))
    found = []
    for i in np.flatnonzero(last >= first):
        for turn in np.arange(first[i], last[i] + 1):
            d = (phases[i] + math.pi - 2.0 * math.pi * turn) / angles[i] - lead
            found.append((float(d), float(angles[i])))
    if not found:
        return float(latency), math.pi
    found.sort(reverse=back)
    for d, angle in found:
        beyond = d - 1e-9 if back else d + 1e-9
        if table.unstable(np.array([beyond + lead]))[0] > 0:
            return d, angle
    return found[-1]


def stable_windows(
    loops: PolyphaseLoop, limit: int | None, step_us: float
) -> list[list[float | None]]:
    """Return the stable stretches of latency as [first, last], us, given the latency limit."""
    if limit is None:
        return [[0.0, None]]
    stable = loops.unstable(np.arange(max(_WINDOWS, 2 * limit + 200))) == 0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], stable.astype(int), [0]])))
    found: list[list[float | None]] = []
    for first, end in edges.reshape(-1, 2):
        low, high = float(first), float(end - 1)
        if len(loops.every) == 1:
            low = 0.0 if first == 0 else crossing_after(loops, int(first), back=True)[0]
            high = crossing_after(loops, int(end - 1))[0]
        found.append([low * step_us, high * step_us])
    return found
