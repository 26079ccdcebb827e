"""Compiled passes over a run's samples: arrays (steps,), for the figures of impacts and spectra."""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.jit import kernel

# Indices into the sums and counts of `exchanged`.
INJECTED, MOST, FED, LARGEST, LAST_PUSH, LAST_PLACE = range(6)  # J, J, J, N, N, m
SUMS = 6
NEXT, SINCE, HELD = range(3)  # steps, -1 for none; whether a last row waits for the next
COUNTS = 3


@kernel(inline=True, borrowed=True)
def _largest_sum(a, b):
    """Largest |a| + |b|; zero where one is no number."""
    most = 0.0
    for i in range(a.size):
        size = abs(a[i]) + abs(b[i])
        if not size <= most:
            if math.isnan(size):
                return 0.0
            most = size
    return most


@kernel(borrowed=True)
def extremes(f_c, f_c1, f_a, f_a1, xi_p):
    """Largest contact force and force of the actuator within the steps, and largest displacement of
    the struck point, all without sign."""
    return _largest_sum(f_c, f_c1), _largest_sum(f_a, f_a1), largest(xi_p)


@kernel(borrowed=True)
def exchanged(first, pushed, moved, bound_j, sums, counts):
    """Follow the work of a force (N) over its place (m) through rows from step `first` on: its sum
    so far, the largest size and value of that, inf where there is no number any more, and since
    when its size is above `bound_j`."""
    if first != counts[NEXT]:
        counts[HELD] = 0  # no work is done over steps that are missing
    if counts[HELD] == 0 and pushed.size == 0:
        return
    start = first - counts[HELD]
    counts[NEXT] = first + pushed.size
    at = 0
    if counts[HELD] == 0:
        sums[LAST_PUSH], sums[LAST_PLACE] = pushed[0], moved[0]
        at = 1
    force, place = sums[LAST_PUSH], sums[LAST_PLACE]
    injected, largest = sums[INJECTED], abs(force)
    known, numbers = not math.isnan(force), True
    for i in range(at, pushed.size):
        injected += force * (moved[i] - place)  # one sum, whatever the blocks: the same bits
        force, place = pushed[i], moved[i]
        sums[INJECTED] = injected
        size = abs(injected)
        if size <= bound_j:
            counts[SINCE] = -1
        elif counts[SINCE] < 0:
            counts[SINCE] = start + i - at
        numbers = numbers and math.isfinite(size)
        sums[MOST], sums[FED] = max(sums[MOST], size), max(sums[FED], injected)
        known = known and not math.isnan(force)
        largest = max(largest, abs(force))
    if not numbers:
        sums[MOST] = sums[FED] = math.inf
    if known:
        sums[LARGEST] = max(sums[LARGEST], largest)
    sums[LAST_PUSH], sums[LAST_PLACE] = force, place
    counts[HELD] = 1


@kernel(borrowed=True)
def fastest(values):
    """Index of the largest size; of the first that is no number, if there is one."""
    at = 0
    for i in range(values.size):
        size = abs(values[i])
        if math.isnan(size):
            return i
        if size > abs(values[at]):
            at = i
    return at


@kernel(borrowed=True)
def all_finite(rows):
    """Whether rows, shape (rows, steps), hold nothing but finite numbers."""
    for row in rows:
        odd = 0
        for value in row:
            odd += not math.isfinite(value)
        if odd:
            return False
    return True


@kernel(borrowed=True)
def largest(values):
    """Largest size; no number where one is none, zero of no values."""
    return abs(values[fastest(values)]) if values.size else 0.0


@kernel(borrowed=True)
def first_of(values, wanted):
    """Index of the first value that is `wanted`, -1 if none is."""
    for i in range(values.size):
        if values[i] == wanted:
            return i
    return -1


@kernel(borrowed=True)
def nonzero(values):
    """First index of what is not zero, and the one after the last; 0, 0 where all is."""
    first, end = 0, values.size
    while first < end and values[first] == 0.0:
        first += 1
    while end > first and values[end - 1] == 0.0:
        end -= 1
    return (first, end) if first < end else (0, 0)


# A fingerprint of samples: 128 bits that chance does not repeat. It is no protection from intent.
_FOLD, _SHIFT = np.uint64(0x9E3779B97F4A7C15), np.uint64(29)


@kernel(inline=True, borrowed=True)
def _fold(state, word):
    """Mix a word of 64 bits into a state of 64 bits, one to one."""
    mixed = (state ^ word) * _FOLD
    return mixed ^ (mixed >> _SHIFT)


@kernel(inline=True, borrowed=True)
def _fold_all(words, lanes):
    """Mix words into four lanes in turn, which the processor follows beside each other."""
    a, b, c, d = lanes
    whole = words.size - words.size % 4
    for i in range(0, whole, 4):
        a, b = _fold(a, words[i]), _fold(b, words[i + 1])
        c, d = _fold(c, words[i + 2]), _fold(d, words[i + 3])
    for i in range(whole, words.size):
        a = _fold(a, words[i])
    return _fold(a, np.uint64(words.size)), b, c, d


@kernel(borrowed=True)
def fingerprint(rows, samples):
    """Two words of 64 bits that tell rows, shape (rows, steps), and samples from others; both are
    arrays of words of 64 bits."""
    lanes = (np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4))
    for row in rows:
        lanes = _fold_all(row, lanes)
    a, b, c, d = _fold_all(samples, lanes)
    return _fold(_fold(a, b), _fold(c, d)), _fold(_fold(b, c), _fold(d, a))


# When an impact is over: the definition that all figures of an impact rest on.
#
# An impact lasts from the first touch until the sphere has left and no force of the law's answer
# remains, at the latest until the next contact, or the end of the run.
#
# Forces alone decide, not what a law promises. A force belongs to the answer if it begins while
# the law answers still: until the actuator has been silent for `quiet_steps`. For `line_steps`
# after the contact it may be on its way. A force that begins later belongs to the answer as well,
# unless the sphere has come back before: the gap has fallen below half of its largest value. Then
# the force meets the next contact.

# Indices into the counts: steps since the first touch; one past the last step of contact or answer;
# from where on silence counts; whether the sphere has left, has come back, and whether it is over.
STEP, END, BUSY, LEFT, BACK, OVER = range(6)
_BACK = 0.5  # of the largest gap


class Answer(NamedTuple):
    """An impact that is followed step by step; `quiet_steps` below zero: none is.

    `rest_n`: force of the actuator without a command.

    `blur_m`: by how much a sample of the gap may be too small; inf where samples are no gap.
    `widest_m`, shape (1,): largest gap since the sphere has left.
    """

    quiet_steps: int
    line_steps: int
    blur_m: float
    counts: np.ndarray
    widest_m: np.ndarray
    rest_n: float


def answer(
    quiet_steps: int, line_steps: int = 0, blur_m: float = math.inf, rest_n: float = 0.0
) -> Answer:
    """An impact before its first touch."""
    counts, widest_m = np.zeros(6, np.int64), np.full(1, -math.inf)
    return Answer(quiet_steps, line_steps, blur_m, counts, widest_m, rest_n)


NEVER = answer(-1)  # what a loop takes that does not end before its last step


@kernel(inline=True, borrowed=True)
def is_silent(impact):
    """Whether nothing has touched or pushed for so long, and nothing from before is on its way."""
    counts = impact.counts
    return counts[LEFT] == 1 and counts[STEP] - counts[BUSY] >= impact.quiet_steps


@kernel(inline=True, borrowed=True)
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
        counts[BUSY] = counts[END] + impact.line_steps
    else:
        counts[LEFT] = 1
        silent = is_silent(impact)
        impact.widest_m[0] = max(impact.widest_m[0], gap)
        if silent and gap < _BACK * impact.widest_m[0]:
            counts[BACK] = 1
        if f_a != impact.rest_n:
            if silent and counts[BACK] == 1:
                counts[OVER] = 1
                return
            counts[END] = counts[STEP] + 1
            counts[BUSY] = max(counts[BUSY], counts[END])
    counts[STEP] += 1


@kernel(borrowed=True)
def follow_rows(impact, f_c, f_a, gap):
    """Take steps, arrays of shape (steps,), until the impact is over; the first in contact."""
    touch = -1
    for i in range(f_c.size):
        follow(impact, f_c[i], f_a[i], gap[i])
        if touch < 0 and f_c[i] != 0.0:
            touch = i
        if impact.counts[OVER] == 1:
            break
    return touch


@kernel(inline=True, borrowed=True)
def keeps(impact, level, value):
    """Whether a promise of no force while samples stay above `level` holds until the sphere has
    come back; `value`: the latest sample."""
    below = level + impact.blur_m < _BACK * impact.widest_m[0]
    return value > level and (level == -math.inf or below)
