"""Compiled passes over rows of truth, arrays of shape (steps,), for the figures of impacts."""

import math

from jit import kernel

# Indices into the sums and counts of `exchanged`.
INJECTED, MOST, FED, LARGEST, LAST_PUSH, LAST_PLACE = range(6)  # J, J, J, N, N, m
SUMS = 6
NEXT, SINCE, HELD = range(3)  # steps, -1 for none; whether a last row waits for the next
COUNTS = 3


@kernel(borrowed=True)
def largest_sum(a, b):
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
    total, largest = 0.0, abs(force)
    known, numbers = not math.isnan(force), True
    before = sums[INJECTED]
    for i in range(at, pushed.size):
        total += force * (moved[i] - place)
        force, place = pushed[i], moved[i]
        injected = before + total
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
def starting_speeds(v_p, f_c, f_c1, f_a, f_a1, same_point, mobility, found):
    """Velocity at the start of every step where what follows the forces at once has `mobility`
    (m/(N s)): it jumps with them. In the first row that of the row."""
    found[0] = v_p[0]
    mean, slope = -f_c[0], -f_c1[0]
    if same_point:
        mean, slope = mean + f_a[0], slope + f_a1[0]
    ended = mean + slope
    for i in range(1, v_p.size):
        mean, slope = -f_c[i], -f_c1[i]
        if same_point:
            mean, slope = mean + f_a[i], slope + f_a1[i]
        found[i] = v_p[i] + mobility * ((mean - slope) - ended)
        ended = mean + slope


@kernel(borrowed=True)
def work_of_means(xi_p, f_c, f_a, xi_a, work):
    """Work of the mean forces over every step but the last, J."""
    for i in range(work.size - 1):
        work[i] = -f_c[i] * (xi_p[i + 1] - xi_p[i]) + f_a[i] * (xi_a[i + 1] - xi_a[i])


@kernel(borrowed=True)
def add_work_of_slopes(slope, v_end, v_start, sign, step_s, work):
    """Add that of their slopes, `sign` F_1 h (v_1 - v_0)/6."""
    for i in range(work.size - 1):
        work[i] += sign * slope[i] * (v_end[i + 1] - v_start[i]) * step_s / 6.0


@kernel(borrowed=True)
def edges_of(values, edges):
    """Steps at which what is not zero begins and ends, in turns, as many as `edges` takes; how
    many there are. What lasts to the end has no end."""
    count, inside = 0, False
    for i in range(values.size):
        if (values[i] != 0.0) != inside:
            inside = not inside
            if count < edges.size:
                edges[count] = i
            count += 1
    return count


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
