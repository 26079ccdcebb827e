"""The clock of a paced run: the plant takes every step when it is due, and waits for no force.

See docs/how-to/paced.md. Nothing allocates.
"""

from typing import NamedTuple

import numpy as np

from hertzloop.bus.ring_kernels import now_ns, sleep_us, yield_core
from hertzloop.common.jit import kernel

# Indices into Clock.counts. START_NS: when step 0 was due; PUT: samples put into the ring; the
# longest response, lateness of a force and lag of the plant behind the clock; time spent waiting
# for the clock; when the newest sample was taken; answers and forces in the statistics.
START_NS, PUT, RESPONSE_MAX_NS, LATE_MAX_NS, BEHIND_MAX_NS, WAITED_NS, LATEST_NS = range(7)
ANSWERS_NOTED, FORCES_NOTED = range(7, 9)
CLOCK_COUNTS = 9
# The histogram has 32 classes an octave, so that a class is 3 % wide at most; up to 2**40 ns.
CLASSES_AN_OCTAVE, CLASSES = 32, 32 * 36
# Before a step that is due in more than _SOON_NS, and with nothing expected, the core sleeps for
# _SLEEP_US; before one due in more than _NEAR_NS it is yielded; otherwise the kernel spins.
_SLEEP_US, _SOON_NS, _NEAR_NS = 50, 200_000, 20_000


class Clock(NamedTuple):
    """What a paced run keeps. Times are of the monotonic clock, ns.

    Attributes:
        held_steps: int32 (steps,): how many steps older than its step the command was. Empty in
            lock-step.
        values: Samples that were not answered, a ring whose size is a power of two.
        taken_ns: When they were taken, a ring of the same size.
        counts: By the indices above.
        histogram: Answers by response time, (CLASSES,).
        step_ns: Wall time of a step.
    """

    held_steps: np.ndarray
    values: np.ndarray
    taken_ns: np.ndarray
    counts: np.ndarray
    histogram: np.ndarray
    step_ns: float


def new_clock(steps: int, room: int, step_ns: float) -> Clock:
    """Return a clock for a run of so many steps, with room for so many unanswered samples."""
    return Clock(
        np.zeros(steps, np.int32),
        np.zeros(room),
        np.zeros(room, np.int64),
        np.zeros(CLOCK_COUNTS, np.int64),
        np.zeros(CLASSES if steps else 0, np.int64),
        step_ns,
    )


@kernel(copied=True)
def due_ns(clock, step):
    """Return when a step is due."""
    return clock.counts[START_NS] + np.int64(step * clock.step_ns)


@kernel(inline=True)
def class_of(ns):
    """Return the class of the histogram that a time belongs to."""
    shift = 0
    while (ns >> shift) >= 2 * CLASSES_AN_OCTAVE:
        shift += 1
    return min(max(0, shift * CLASSES_AN_OCTAVE + (ns >> shift)), CLASSES - 1)


@kernel(copied=True)
def note_answers(clock, now, answered, forces):
    """Note what has come at a time: answers to `answered` samples, forces of `forces` steps."""
    counts = clock.counts
    for i in range(counts[ANSWERS_NOTED], answered):
        took = now - clock.taken_ns[i & (clock.taken_ns.size - 1)]
        clock.histogram[class_of(took)] += 1
        counts[RESPONSE_MAX_NS] = max(counts[RESPONSE_MAX_NS], took)
    counts[ANSWERS_NOTED] = answered
    for step in range(counts[FORCES_NOTED], forces):
        if clock.held_steps[step] > 0:
            counts[LATE_MAX_NS] = max(counts[LATE_MAX_NS], now - due_ns(clock, step))
            break  # the oldest is the latest
    counts[FORCES_NOTED] = forces


@kernel(copied=True)
def keep_sample(clock, index, value, now):
    """Keep a sample until there is room for it in the ring, and when it was taken."""
    at = index & (clock.values.size - 1)
    clock.values[at] = value
    clock.taken_ns[at] = clock.counts[LATEST_NS] = now


@kernel(copied=True)
def wait_until_due(clock, ring, left_ns, all_answered, now):
    """Let some time pass before a step that is due in `left_ns`."""
    quiet = all_answered or now - clock.counts[LATEST_NS] > _SOON_NS
    if quiet and left_ns > _SOON_NS:
        sleep_us(_SLEEP_US)
    elif left_ns > _NEAR_NS or ring.spins == 0:
        yield_core()
    clock.counts[WAITED_NS] += now_ns() - now
