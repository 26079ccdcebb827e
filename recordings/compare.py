"""Do two recordings hold the same samples? How they are cut into blocks does not count."""

import numpy as np

from hertzloop.bus.streams import STREAMS
from hertzloop.recordings.recording import SAMPLED, Recording, SampledStream

_COMPARED = tuple(name for name in SAMPLED if STREAMS[name].compared)
# A slope is solved for together with its force, and is as exact as that.
_MEASURED_BY = {"f_c1_n": "f_c_n", "f_a1_n": "f_a_n"}


def first_difference(
    a: Recording, b: Recording, tolerance: float = 0.0, until_step: int | None = None
) -> str | None:
    """Return one sentence on the first difference between the compared streams.

    Args:
        a: A recording.
        b: Another recording.
        tolerance: Allowed difference of samples, relative to the largest value of their field, for
            runs on different processors. Above zero, the words of events do not count.
        until_step: Only samples and events before this step count.

    Returns:
        The sentence; None if the bytes of all samples and all events agree.
    """
    for name in _COMPARED:
        difference = _streams(name, getattr(a, name), getattr(b, name), tolerance, until_step)
        if difference:
            return difference
    until_ns = None if until_step is None else until_step * a.truth.step_ns
    return _events(a, b, words=tolerance == 0.0, until_ns=until_ns)


def _streams(
    name: str, a: SampledStream, b: SampledStream, tolerance: float, until_step: int | None
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
    wanted = None if until_step is None else -(-until_step // a.every_steps)
    count = min(a.samples, b.samples) if wanted is None else min(a.samples, b.samples, wanted)
    earliest: tuple[int, str] | None = None
    for field in a.arrays:
        unequal = _unequal(a, b, field, tolerance, count)
        if unequal >= 0 and (earliest is None or unequal < earliest[0]):
            earliest = (unequal, field)
    if earliest:
        at, field = earliest
        values_there = f"{a.arrays[field][at].item()!r} and {b.arrays[field][at].item()!r}"
        return f"{name}.{field} differs first at step {at * a.every_steps}: {values_there}"
    return counts if a.samples != b.samples and count != wanted else None


def _unequal(a: SampledStream, b: SampledStream, field: str, tolerance: float, count: int) -> int:
    """Return the first of `count` positions where two arrays differ; -1 if none does."""
    left, right = a.arrays[field][:count], b.arrays[field][:count]
    # Bytes, not values: -0.0 and 0.0 differ, a NaN equals itself.
    at = np.flatnonzero(left.view(f"u{left.itemsize}") != right.view(f"u{right.itemsize}"))
    if tolerance and len(at):
        measure = a.arrays[_MEASURED_BY.get(field, field)]
        finite = np.abs(measure[np.isfinite(measure)].astype(float))
        allowed = tolerance * float(np.max(finite, initial=0.0))
        at = at[~(np.abs(left[at].astype(float) - right[at].astype(float)) <= allowed)]
    return int(at[0]) if len(at) else -1


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
