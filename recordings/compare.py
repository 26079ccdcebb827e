"""Do two recordings hold the same samples? How they are cut into blocks does not count."""

import numpy as np

from recordings.reader import Recording, Stream

_COMPARED = ("daq", "force", "truth")


def first_difference(a: Recording, b: Recording) -> str | None:
    """One sentence on the first difference between the compared streams, None if the bytes
    of all samples and all events agree."""
    for name in _COMPARED:
        difference = _streams(name, getattr(a, name), getattr(b, name))
        if difference:
            return difference
    return _events(a, b)


def _streams(name: str, a: Stream, b: Stream) -> str | None:
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
        # Bytes, not values: -0.0 and 0.0 differ, a NaN equals itself.
        unequal = np.flatnonzero(_bits(left[:count]) != _bits(right[:count]))
        if len(unequal) and (earliest is None or unequal[0] < earliest[0]):
            at = int(unequal[0])
            step = a.first_step + at * a.every_steps
            text = f"{name}.{field} differs first at step {step}: {left[at]!r} and {right[at]!r}"
            earliest = (at, text)
    if earliest:
        return earliest[1]
    if a.samples != b.samples:
        return f"{name} has {a.samples} samples in one and {b.samples} in the other"
    return None


def _bits(values: np.ndarray) -> np.ndarray:
    return values.view(f"u{values.dtype.itemsize}")


def _events(a: Recording, b: Recording) -> str | None:
    for name in sorted({event.name for event in [*a.events, *b.events]}):
        left = [event for event in a.events if event.name == name]
        right = [event for event in b.events if event.name == name]
        for one, other in zip(left, right, strict=False):
            if one != other:
                return f"events of the {name} differ first: {one} and {other}"
        if len(left) != len(right):
            return f"the {name} logged {len(left)} events in one and {len(right)} in the other"
    return None
