"""Do two recordings hold the same samples? How they are cut into blocks does not count."""

import numpy as np

from recordings.reader import Recording, Stream

_COMPARED = ("daq", "force", "truth")


def first_difference(a: Recording, b: Recording, tolerance: float = 0.0) -> str | None:
    """One sentence on the first difference between the compared streams, None if the bytes
    of all samples and all events agree.

    A `tolerance` above zero is for runs on different processors: samples may differ by so
    much of the largest value of their field, and the words of events do not count.
    """
    for name in _COMPARED:
        difference = _streams(name, getattr(a, name), getattr(b, name), tolerance)
        if difference:
            return difference
    return _events(a, b, words=tolerance == 0.0)


def _streams(name: str, a: Stream, b: Stream, tolerance: float) -> str | None:
    counts = f"{name} has {a.samples} samples in one and {b.samples} in the other"
    if bool(a.messages) != bool(b.messages):
        return counts
    for label in ("step_ns", "every_steps", "scale", "offset"):
        left, right = getattr(a, label), getattr(b, label)
        if left != right:
            return f"{name}.{label} differs: {left} and {right}"
    if set(a.arrays) != set(b.arrays):
        return f"{name} has fields {sorted(a.arrays)} and {sorted(b.arrays)}"
    earliest: tuple[int, str] | None = None
    for field, left in a.arrays.items():
        right = b.arrays[field]
        count = min(len(left), len(right))
        unequal = _unequal(left[:count], right[:count], tolerance)
        if len(unequal) and (earliest is None or unequal[0] < earliest[0]):
            at = int(unequal[0])
            step = a.first_step + at * a.every_steps
            values = f"{left[at].item()!r} and {right[at].item()!r}"
            earliest = (at, f"{name}.{field} differs first at step {step}: {values}")
    if earliest:
        return earliest[1]
    if a.samples != b.samples:
        return counts
    return None


def _unequal(a: np.ndarray, b: np.ndarray, tolerance: float) -> np.ndarray:
    """Positions where two arrays differ."""
    # Bytes, not values: -0.0 and 0.0 differ, a NaN equals itself.
    at = np.flatnonzero(_bits(a) != _bits(b))
    if tolerance == 0.0 or not len(at):
        return at
    allowed = tolerance * float(np.max(np.abs(a[np.isfinite(a)]), initial=0.0))
    far = ~(np.abs(a[at].astype(float) - b[at].astype(float)) <= allowed)
    return np.asarray(at[far])


def _bits(values: np.ndarray) -> np.ndarray:
    return values.view(f"u{values.dtype.itemsize}")


def _events(a: Recording, b: Recording, words: bool) -> str | None:
    for name in sorted({event.name for event in [*a.events, *b.events]}):
        left = [event for event in a.events if event.name == name]
        right = [event for event in b.events if event.name == name]
        for one, other in zip(left, right, strict=False):
            same = one == other if words else one.time_ns == other.time_ns
            if not same:
                return f"events of the {name} differ first: {one} and {other}"
        if len(left) != len(right):
            return f"the {name} logged {len(left)} events in one and {len(right)} in the other"
    return None
