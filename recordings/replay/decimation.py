"""Decimation of signals for plots: fewer samples that look the same.

A long run takes the memory of a short one this way.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hertzloop.recordings.replay.contacts import Span

OVERVIEW_POINTS = 6000
OUTSIDE_POINTS = 40_000  # of a zoom curve, away from contacts
FULL_RATE_SAMPLES = 150_000  # of a zoom curve; more makes the viewer slow
_PADDING = 20_000  # samples at full rate before and after a contact, if the limit allows


def extremes(values: np.ndarray, points: int) -> np.ndarray:
    """Return ascending positions of samples that keep minimum and maximum of equal pieces.

    Both ends are kept, too. They are at most about `points`.
    """
    count = len(values)
    width = -(-2 * count // points)
    if width <= 2:
        return np.arange(count)
    whole = count // width * width
    starts = np.arange(0, whole, width)
    pieces = values[:whole].reshape(-1, width)
    kept = [np.array([0, count - 1])]
    kept += [starts + pieces.argmin(axis=1), starts + pieces.argmax(axis=1)]
    if rest := count - whole:
        kept += [whole + np.array([values[-rest:].argmin(), values[-rest:].argmax()])]
    shown = np.zeros(count, bool)
    shown[np.concatenate(kept)] = True
    return np.flatnonzero(shown)


def enough(time_ns: np.ndarray, values: np.ndarray, within: float, held: bool) -> np.ndarray:
    """Return ascending positions of samples that suffice to draw a signal.

    Straight lines between them, or held values if the signal is `held`, differ from all values by
    at most `within`.
    """
    kept = np.ones(len(values), bool)
    time, width = time_ns.astype(float), 1
    good: np.ndarray = np.ones(max(len(values) - 1, 0), bool)  # pieces so wide
    while len(good) > 1:
        good = good[:-1:2] & good[1::2]
        width *= 2
        tried = np.flatnonzero(good)
        at = tried[:, None] * width + np.arange(width + 1)
        value, when = values[at], time[at] - time[at[:, :1]]
        with np.errstate(invalid="ignore", over="ignore"):  # of values without bound
            slope = 0.0 if held else (value[:, -1:] - value[:, :1]) / when[:, -1:]
            error = abs(value[:, :1] + slope * when - value)[:, :-1].max(axis=1, initial=0.0)
        good[tried] = error <= within
        kept[at[good[tried], 1:-1]] = False
    return np.flatnonzero(kept)


def full_rate_spans(contacts: Sequence[Span], count: int) -> list[Span]:
    """Return the spans at full rate: all of a short run, else the surroundings of contacts.

    At most `FULL_RATE_SAMPLES` in all; the earliest contacts come first.
    """
    if count <= FULL_RATE_SAMPLES:
        return [(0, count)] if count else []
    left = FULL_RATE_SAMPLES
    padding = min(_PADDING, left // (4 * max(1, len(contacts))))
    spans: list[Span] = []
    for start, end in contacts:
        first = max(spans[-1][1] if spans else 0, start - padding)
        last = min(count, end + padding, first + left)
        if first < last:
            spans.append((first, last))
            left -= last - first
        if not left:
            break
    return spans


@dataclass(frozen=True)
class Line:
    """A decimated signal.

    Attributes:
        at: Ascending positions of the samples that are kept, (kept,).
        values: Their values, (kept,).
        overview: Which of them suffice for the whole run, (points,).
    """

    at: np.ndarray
    values: np.ndarray
    overview: np.ndarray


def decimated(values: np.ndarray, contacts: Sequence[Span]) -> Line:
    """Return fewer samples of a signal: all of them around contacts and of a short signal, and the
    minimum and maximum of equal pieces elsewhere."""
    whole = extremes(values, OVERVIEW_POINTS)
    shown = np.zeros(len(values), bool)
    shown[whole] = True
    shown[extremes(values, OUTSIDE_POINTS)] = True
    for first, end in full_rate_spans(contacts, len(values)):
        shown[first:end] = True
    at = np.flatnonzero(shown)
    return Line(at, values[at], np.searchsorted(at, whole))
