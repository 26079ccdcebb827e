"""Moments of a run that are worth looking at."""

from dataclasses import dataclass

from hertzloop.bus.streams import LAST_NS
from hertzloop.recordings.replay.contacts import Span


@dataclass(frozen=True)
class Moments:
    """When something is worth looking at, ns: what play shows, what zoom plots reach before
    and after the cursor, and the time of a still picture."""

    selection_ns: Span
    zoom_ns: Span
    still_ns: int

    @property
    def around_ns(self) -> Span:
        """What zoom plots show in a still picture."""
        return self.still_ns - self.zoom_ns[0], self.still_ns + self.zoom_ns[1]


def moments(
    run_ns: Span, contact_ns: Span | None, step_ns: int, until_ns: int = LAST_NS
) -> Moments:
    """Moments around the first contact, from its first step to the first one after it, before a
    loop explodes at `until_ns`; without a contact, the whole recording, its first and last step."""
    first, last = run_ns[0], min(run_ns[1], until_ns)
    if contact_ns is None:
        half = max(last - first, step_ns) // 2
        return Moments((first, max(last, first + step_ns)), (half, half), (first + last) // 2)
    start, end = contact_ns
    begun, length = min(start, last), max(end - start, 4 * step_ns)
    selection = (max(first, begun - length), min(last, begun + 9 * length))
    still, after = begun + 2 * length, min(3 * length, last - first) // 2
    if still > last:  # the run ends in this contact, or soon after it
        still = begun + 2 * (last - begun) // 3
    if until_ns < LAST_NS or still + after > last:
        after = max(min(after, last - still), step_ns)
    before = still - begun + min(length // 2, max(begun - first, length // 8))
    return Moments(selection, (before, after), still)
