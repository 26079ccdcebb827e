"""What a replay keeps of a run, found as its samples come: contacts, thinned lines, single rows.

A long run takes the memory of a short one this way.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from recordings.columns import Arrays, Stream

OVERVIEW_POINTS = 6000
OUTSIDE_POINTS = 40_000  # of a zoom curve, away from contacts
FULL_RATE_SAMPLES = 150_000  # of a zoom curve; more makes the viewer slow
_PADDING = 20_000  # samples at full rate before and after a contact, if the limit allows

Span = tuple[int, int]


@dataclass(frozen=True)
class Contact:
    """Positions of the first sample in contact and of the first one after it; largest force and
    penetration in between, N and m."""

    first: int
    end: int
    peak_n: float
    deepest_m: float

    def joined(self, later: "Contact") -> "Contact":
        """Both as one."""
        return Contact(
            self.first,
            later.end,
            max(self.peak_n, later.peak_n),
            max(self.deepest_m, later.deepest_m),
        )


def contact_spans(xi_m: np.ndarray) -> list[Span]:
    """First step in contact and first step after it, for every contact, from the gap (steps,)."""
    touching = np.concatenate([[0], (xi_m < 0.0).astype(np.int8), [0]])
    edges = np.flatnonzero(np.diff(touching))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def contacts_of(pieces: Iterable[tuple[int, Arrays]]) -> list[Contact]:
    """Contacts of a run from pieces of its truth, each with the position of its first row."""
    found: list[Contact] = []
    for at, arrays in pieces:
        xi, force = arrays["xi_m"], arrays["f_c_n"]
        for a, b in contact_spans(xi):
            deepest, peak = -float(xi[a:b].min()), float(force[a:b].max())
            contact = Contact(at + a, at + b, peak, deepest)
            if found and found[-1].end == contact.first:
                found[-1] = found[-1].joined(contact)
            else:
                found.append(contact)
    return found


def rows_at(stream: Stream, positions: np.ndarray, names: Sequence[str]) -> Arrays:
    """The samples at ascending positions, each array (positions,)."""
    found: dict[str, list[np.ndarray]] = {name: [np.empty(0)] for name in names}
    for at, arrays in stream.pieces():
        count = len(next(iter(arrays.values())))
        a, b = np.searchsorted(positions, (at, at + count))
        for name, parts in found.items():
            parts.append(arrays[name][positions[a:b] - at])
    return {name: np.concatenate(parts) for name, parts in found.items()}


def extremes(values: np.ndarray, points: int) -> np.ndarray:
    """Ascending positions of at most about `points` samples that keep each minimum and maximum
    of equal pieces, and both ends."""
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


def full_rate_spans(contacts: Sequence[Span], count: int) -> list[Span]:
    """Samples shown at full rate: everything in a short run, else the surroundings of contacts.

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
    """A thinned signal: `at` (kept,) ascending positions of what is kept, `values` (kept,), and
    which of these are enough for all of it at once, `overview` (points,)."""

    at: np.ndarray
    values: np.ndarray
    overview: np.ndarray


def within(spans: Sequence[Span], first: int, count: int) -> np.ndarray:
    """Which of `count` positions from `first` on lie in spans (ascending, apart)."""
    found = np.zeros(count, bool)
    ends = np.array(spans, np.int64).reshape(-1, 2)[:, 1]
    for a, b in spans[int(np.searchsorted(ends, first, "right")) :]:
        if a >= first + count:
            break
        found[max(a - first, 0) : b - first] = True
    return found


class Thinner:
    """Keeps of a signal of `samples` values those that are marked, and smallest and largest of
    equal pieces elsewhere; all of a short one."""

    def __init__(self, samples: int) -> None:
        self._samples = samples
        self._at: list[np.ndarray] = []
        self._values: list[np.ndarray] = []
        self._overview: list[np.ndarray] = []
        self._kept = 0

    def feed(self, first: int, values: np.ndarray, marked: np.ndarray) -> None:
        """The values from position `first` on; `marked`, of the same shape, are kept."""
        shown, whole = marked.copy(), extremes(values, self._share(len(values), OVERVIEW_POINTS))
        shown[whole] = True
        outside = self._share(len(values), OUTSIDE_POINTS)
        short = self._samples <= FULL_RATE_SAMPLES
        shown[slice(None) if short else extremes(values, outside)] = True
        kept = np.flatnonzero(shown)
        self._at.append(first + kept)
        self._values.append(values[kept])
        self._overview.append(self._kept + np.searchsorted(kept, whole))
        self._kept += len(kept)

    def _share(self, count: int, points: int) -> int:
        """Of so many points, those for `count` values."""
        return max(4, count * points // max(self._samples, 1))

    def line(self) -> Line:
        """What was kept."""
        if not self._at:
            nothing = np.empty(0, np.int64)
            return Line(nothing, np.empty(0), nothing)
        parts = (self._at, self._values, self._overview)
        return Line(*(np.concatenate(part) for part in parts))
