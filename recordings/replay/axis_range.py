"""Ranges of the value axes of plots."""

import math

import numpy as np

from hertzloop.recordings.replay.contacts import Span
from hertzloop.recordings.replay.plots import Plot

Range = tuple[float, float]
_MARGIN = 0.06
_RUNAWAY = 20.0  # times as large as around the first contact: a zoom shows the contact
_HUGE = 1e300  # beyond it, the length of a range overflows
_GAPS = 1.8  # of the deepest penetration, that a zoom shows above the plate


def padded(low: float, high: float) -> Range:
    """[low, high] with a margin; a range around a constant; -1 to 1 without finite ends."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return -1.0, 1.0
    low, high = (min(max(end, -_HUGE), _HUGE) for end in sorted((low, high)))
    if high - low < 1e-12 * max(abs(low), abs(high), 1e-30):
        reach = max(abs(low), 1.0)
        low, high = low - reach, high + reach
    margin = _MARGIN * (high - low)
    return low - margin, high + margin


def whole(plot: Plot) -> Range:
    """For all of a plot's curves; energies of what explodes are cut."""
    low, high = _extremes([curve.values for curve in plot.curves])
    if plot.most is not None:
        low, high = max(low, -plot.most), min(high, plot.most)
    return padded(low, high)


def zoomed(plot: Plot, around_ns: Span) -> Range:
    """For a zoom that first shows a span of time and then follows the cursor.

    A gap is shown down to its deepest and not as far up as the sphere flies; what explodes is
    shown as around the first contact.
    """
    shown = [
        slice(a, b + 1)
        for a, b in (np.searchsorted(curve.time_ns, around_ns) for curve in plot.curves)
    ]
    first = _extremes([c.values[s] for c, s in zip(plot.curves, shown, strict=True)])
    ever = _extremes([curve.values for curve in plot.curves])
    if plot.key == "gap" and ever[0] < 0.0:
        deepest = first[0] if ever[0] < _RUNAWAY * first[0] < 0.0 else ever[0]
        return padded(deepest, min(-_GAPS * deepest, max(first[1], 0.0)))
    size = max(map(abs, first))
    runs_away = 0.0 < _RUNAWAY * size < max(map(abs, ever))
    return padded(*(first if runs_away else ever))


def _extremes(parts: list[np.ndarray]) -> Range:
    reaches = [_finite(values) for values in parts if len(values)]
    found = [reach for reach in reaches if reach is not None]
    if not found:
        return 0.0, 1.0
    return min(low for low, _ in found), max(high for _, high in found)


def _finite(values: np.ndarray) -> Range | None:
    """Smallest and largest value, of those that are finite; without a copy where all are."""
    low, high = float(values.min()), float(values.max())
    if math.isfinite(low) and math.isfinite(high):
        return low, high
    kept = values[np.isfinite(values)]
    return (float(kept.min()), float(kept.max())) if len(kept) else None
