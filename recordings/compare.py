"""Do two recordings hold the same samples? How they are cut into blocks does not count."""

from collections.abc import Iterator

import numpy as np

from hertzloop.bus.streams import STREAMS
from hertzloop.recordings.joined_stream import Arrays, JoinedStream
from hertzloop.recordings.recording import SAMPLED, Recording

_COMPARED = tuple(name for name in SAMPLED if STREAMS[name].compared)
# A slope is solved for together with its force, and is as exact as that.
_MEASURED_BY = {"f_c1_n": "f_c_n", "f_a1_n": "f_a_n"}


def first_difference(
    a: Recording, b: Recording, tolerance: float = 0.0, until_step: int | None = None
) -> str | None:
    """One sentence on the first difference between the compared streams, None if the bytes
    of all samples and all events agree.

    A `tolerance` above zero is for runs on different processors: samples may differ by so
    much of the largest value of their field, and the words of events do not count. Only samples of
    steps before `until_step` do, where that is given, and events before it. Raises RecordingError
    if a file changes meanwhile.
    """
    for name in _COMPARED:
        difference = _streams(name, getattr(a, name), getattr(b, name), tolerance, until_step)
        if difference:
            return difference
    until_ns = None if until_step is None else until_step * a.truth.step_ns
    return _events(a, b, words=tolerance == 0.0, until_ns=until_ns)


def _streams(
    name: str, a: JoinedStream, b: JoinedStream, tolerance: float, until_step: int | None
) -> str | None:
    counts = f"{name} has {a.samples} samples in one and {b.samples} in the other"
    if bool(a.messages) != bool(b.messages):
        return counts
    for label in ("step_ns", "every_steps", "scale", "offset"):
        left, right = getattr(a, label), getattr(b, label)
        if left != right:
            return f"{name}.{label} differs: {left} and {right}"
    if set(a.arrays) != set(b.arrays):
        return f"{name} has fields {sorted(a.arrays)} and {sorted(b.arrays)}"
    allowed = _allowed(a, tolerance)
    apart = _first_apart(a, b)
    for position, left, right in _side_by_side(a, b, apart):
        earliest: tuple[int, str] | None = None
        for field, values in left.items():
            unequal = _unequal(values, right[field], allowed.get(field))
            if len(unequal) and (earliest is None or unequal[0] < earliest[0]):
                earliest = (int(unequal[0]), field)
        if earliest:
            at, field = earliest
            if until_step is not None and a.step_at(position + at) >= until_step:
                return None
            values_there = f"{left[field][at].item()!r} and {right[field][at].item()!r}"
            step = a.step_at(position + at)
            return f"{name}.{field} differs first at step {step}: {values_there}"
    if apart is not None:
        missing = min(int(a.step_at(apart)), int(b.step_at(apart)))
        if until_step is not None and missing >= until_step:
            return None
        return f"{name} has step {missing} in one and not in the other"
    return counts if a.samples != b.samples else None


def _first_apart(a: JoinedStream, b: JoinedStream) -> int | None:
    """Return the first position at which the streams have samples of different steps."""
    if min(a.samples, b.samples) and a.first_step != b.first_step:
        return 0
    positions = [position for position, _ in set(a.resumed) ^ set(b.resumed)]
    first = min(positions, default=a.samples)
    return first if first < min(a.samples, b.samples) else None


def _side_by_side(
    a: JoinedStream, b: JoinedStream, end: int | None
) -> Iterator[tuple[int, Arrays, Arrays]]:
    """Position and arrays of pieces that are as long in both, up to the position `end` or the end
    of the shorter."""
    position = 0
    left_blocks, right_blocks = a.blocks(), b.blocks()
    left: Arrays = {}
    right: Arrays = {}
    while True:
        left = left or next(left_blocks, {})
        right = right or next(right_blocks, {})
        if not left or not right:
            return
        count = min(_length(left), _length(right))
        if end is not None:
            count = min(count, end - position)
        if count == 0:
            return
        yield position, _cut(left, 0, count), {n: right[n][:count] for n in left}
        position += count
        left, right = _cut(left, count, None), _cut(right, count, None)


def _length(arrays: Arrays) -> int:
    return min(len(values) for values in arrays.values())


def _cut(arrays: Arrays, first: int, end: int | None) -> Arrays:
    """A part of every array; nothing at all if it is empty."""
    cut = {name: values[first:end] for name, values in arrays.items()}
    return cut if _length(cut) else {}


def _allowed(stream: JoinedStream, tolerance: float) -> dict[str, float]:
    """Allowed difference by field, from its largest finite value; empty for none at all."""
    if tolerance == 0.0:
        return {}
    largest = dict.fromkeys(stream.arrays, 0.0)
    for arrays in stream.blocks():
        for field, values in arrays.items():
            finite = np.abs(values[np.isfinite(values)].astype(float))
            largest[field] = max(largest[field], float(np.max(finite, initial=0.0)))
    return {field: tolerance * largest[_MEASURED_BY.get(field, field)] for field in stream.arrays}


def _unequal(a: np.ndarray, b: np.ndarray, allowed: float | None) -> np.ndarray:
    """Positions where two arrays differ, by more than `allowed` if that is given."""
    # Bytes, not values: -0.0 and 0.0 differ, a NaN equals itself.
    at = np.flatnonzero(_bits(a) != _bits(b))
    if allowed is None or not len(at):
        return at
    far = ~(np.abs(a[at].astype(float) - b[at].astype(float)) <= allowed)
    return np.asarray(at[far])


def _bits(values: np.ndarray) -> np.ndarray:
    return values.view(f"u{values.dtype.itemsize}")


def _events(a: Recording, b: Recording, words: bool, until_ns: int | None) -> str | None:
    for name in sorted({event.name for event in [*a.events, *b.events]}):
        left, right = (
            [e for e in events if e.name == name and (until_ns is None or e.time_ns < until_ns)]
            for events in (a.events, b.events)
        )
        for one, other in zip(left, right, strict=False):
            same = one == other if words else one.time_ns == other.time_ns
            if not same:
                data = f", as {one.data} and {other.data}" if repr(one) == repr(other) else ""
                return f"events of the {name} differ first: {one} and {other}{data}"
        if len(left) != len(right):
            return f"the {name} logged {len(left)} events in one and {len(right)} in the other"
    return None
