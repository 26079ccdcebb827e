"""When an impact is over: the definition that all metrics of an impact rest on.

An impact lasts from the first touch until the sphere has left and no force of the law's answer
remains, at the latest until the next contact, or the end of the run.

Forces alone decide, not what a law promises. A force belongs to the answer if it begins while
the law answers still: until the actuator has been silent for `quiet_steps`. For `path_steps`
after the contact it may be on its way. A force that begins later belongs to the answer as well,
unless the sphere has come back before: the gap has fallen below half of its largest value. Then
the force meets the next contact.
"""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel

# Indices into the counts: steps since the first touch; one past the last step of contact or answer;
# from where on silence counts; whether the sphere has left, has come back, and whether it is over.
STEP, END, BUSY, LEFT, BACK, OVER = range(6)
_BACK = 0.5  # of the largest gap


class ImpactFollower(NamedTuple):
    """An impact that is followed step by step; `quiet_steps` below zero: none is.

    `widest_m`, shape (1,): largest gap since the sphere has left.
    """

    quiet_steps: int
    path_steps: int
    counts: np.ndarray
    widest_m: np.ndarray


def new_follower(quiet_steps: int, path_steps: int = 0) -> ImpactFollower:
    """An impact before its first touch."""
    counts, widest_m = np.zeros(6, np.int64), np.full(1, -math.inf)
    return ImpactFollower(quiet_steps, path_steps, counts, widest_m)


NEVER = new_follower(-1)  # what a loop takes that does not end before its last step


@kernel(part=True)
def is_silent(impact):
    """Whether nothing has touched or pushed for so long, and nothing from before is on its way."""
    counts = impact.counts
    return counts[LEFT] == 1 and counts[STEP] - counts[BUSY] >= impact.quiet_steps


@kernel(part=True)
def follow(impact, f_c, f_a, gap):
    """Take a step: its contact force and actuator force (N), and the gap at its start (m)."""
    counts = impact.counts
    if counts[OVER] == 1 or (f_c == 0.0 and counts[STEP] == 0):
        return
    if f_c != 0.0:
        if counts[LEFT] == 1:
            counts[OVER] = 1
            return
        counts[END] = counts[STEP] + 1
        counts[BUSY] = counts[END] + impact.path_steps
    else:
        counts[LEFT] = 1
        silent = is_silent(impact)
        impact.widest_m[0] = max(impact.widest_m[0], gap)
        if silent and gap < _BACK * impact.widest_m[0]:
            counts[BACK] = 1
        if f_a != 0.0:
            if silent and counts[BACK] == 1:
                counts[OVER] = 1
                return
            counts[END] = counts[STEP] + 1
            counts[BUSY] = max(counts[BUSY], counts[END])
    counts[STEP] += 1


@kernel
def follow_steps(impact, f_c, f_a, gap):
    """Take steps, arrays of shape (steps,), until the impact is over; the first in contact."""
    touch = -1
    for i in range(f_c.size):
        follow(impact, f_c[i], f_a[i], gap[i])
        if touch < 0 and f_c[i] != 0.0:
            touch = i
        if impact.counts[OVER] == 1:
            break
    return touch


@kernel(part=True)
def least_gap(impact):
    """Smallest gap (m) until the sphere has come back, and for how many steps it has been at least
    half of the largest gap until then; of an impact that `is_silent`."""
    counts = impact.counts
    return _BACK * impact.widest_m[0], counts[STEP] - counts[BUSY] - impact.quiet_steps
