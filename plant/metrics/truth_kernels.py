"""Compiled passes over a run's samples: arrays (steps,), for the metrics of impacts and spectra."""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel

# Indices into the sums and counts of `exchanged`.
INJECTED, MOST, FED, LARGEST, LAST_PUSH, LAST_PLACE = range(6)  # J, J, J, N, N, m
SUMS = 6
NEXT, SINCE, HELD = range(3)  # steps, -1 for none; whether a last row waits for the next
COUNTS = 3
_WHOLE = 4  # steps that a contact has at least, for two whole ones beside each other
_AT_ONCE = 128  # frequencies, so that their powers of a block stay in the processor's cache


@kernel(inline=True)
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


@kernel
def extremes(f_c, f_c1, f_a, f_a1, xi_p):
    """Largest contact force and force of the actuator within the steps, and largest displacement of
    the struck point, all without sign."""
    return _largest_sum(f_c, f_c1), _largest_sum(f_a, f_a1), largest(xi_p)


@kernel
def exchanged(first, pushed, moved, bound_j, sums, counts):
    """Follow the work of a force (N) over its place (m) through steps from step `first` on: its sum
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


@kernel
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


@kernel(inline=True)
def _add_work_of_slopes(slope, v_end, v_start, sign, step_s, work):
    """Add the work of the slopes, `sign` F_1 h (v_1 - v_0)/6."""
    for i in range(work.size - 1):
        work[i] += sign * slope[i] * (v_end[i + 1] - v_start[i]) * step_s / 6.0


@kernel(inline=True)
def _gradient(values, at, step_s):
    """Derivative of values `step_s` apart, by central differences."""
    if at == 0:
        return (values[1] - values[0]) / step_s
    if at == values.size - 1:
        return (values[at] - values[at - 1]) / step_s
    return (values[at + 1] - values[at - 1]) / (2.0 * step_s)


@kernel
def step_work(xi_p, f_c, f_a, xi_a, f_c1, f_a1, v_p, v_start, step_s, impedance, same_point, work):
    """See plant.metrics.impacts.step_work_j; `impedance` is nan, and arrays that are not known are
    empty."""
    if work.size == 0:
        return
    work[work.size - 1] = 0.0
    for i in range(work.size - 1):
        work[i] = -f_c[i] * (xi_p[i + 1] - xi_p[i]) + f_a[i] * (xi_a[i + 1] - xi_a[i])
    if not math.isnan(impedance):
        for i in range(work.size - 1):
            work[i] += f_c1[i] * f_c1[i] * step_s / (3.0 * impedance)
    elif v_start.size:
        _add_work_of_slopes(f_c1, v_p, v_start, -1.0, step_s, work)
    if f_a1.size == 0 or v_start.size == 0 or work.size == 1 or nonzero(f_a1)[1] == 0:
        return
    if same_point:
        _add_work_of_slopes(f_a1, v_p, v_start, 1.0, step_s, work)
        return
    for i in range(work.size - 1):
        change = _gradient(xi_a, i + 1, step_s) - _gradient(xi_a, i, step_s)
        work[i] += f_a1[i] * change * step_s / 6.0


@kernel
def plate_work(
    displaced,
    xi_a,
    v_p,
    f_c,
    f_a,
    f_c1,
    f_a1,
    first,
    same_point,
    mobility,
    impedance,
    step_s,
    speeds,
    work,
):
    """The `work` of every row from `first` on, as `step_work` has it; `speeds` is room. `mobility`,
    `impedance`: see `Reading`."""
    if not math.isnan(mobility):
        starting_speeds(v_p, f_c, f_c1, f_a, f_a1, same_point, mobility, speeds)
    else:
        for i in range(v_p.size):
            speeds[i] = v_p[i]
    part = slice(first, work.size)
    place = displaced[part] if same_point else xi_a[part]
    step_work(
        displaced[part],
        f_c[part],
        f_a[part],
        place,
        f_c1[part],
        f_a1[part],
        v_p[part],
        speeds[part],
        step_s,
        impedance,
        same_point,
        work[part],
    )


@kernel
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


@kernel
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


@kernel
def all_finite(truth):
    """Whether steps, shape (columns, steps), hold nothing but finite numbers."""
    for row in truth:
        odd = 0
        for value in row:
            odd += not math.isfinite(value)
        if odd:
            return False
    return True


@kernel
def largest(values):
    """Largest size; no number where one is none, zero of no values."""
    return abs(values[fastest(values)]) if values.size else 0.0


@kernel
def first_of(values, wanted):
    """Index of the first value that is `wanted`, -1 if none is."""
    for i in range(values.size):
        if values[i] == wanted:
            return i
    return -1


@kernel(inline=True)
def _highest(mean, slope):
    """Largest F_0, its index, largest end of the steps' lines, and whether there are slopes."""
    at, top, sloped = 0, -math.inf, False
    for i in range(mean.size):
        if math.isnan(mean[i]):
            return math.nan, i, math.nan, True
        if mean[i] > mean[at]:
            at = i
        end = mean[i] + abs(slope[i])
        top = end if end > top or math.isnan(end) else top
        sloped = sloped or slope[i] != 0.0
    return mean[at], at, top, sloped


@kernel(inline=True)
def _at(c0, c1, c2, c3, x):
    return c0 + x * (c1 + x * (c2 + x * c3))


@kernel(inline=True)
def _largest(c0, c1, c2, c3):
    """Largest value of c0 + c1 x + c2 x^2 + c3 x^3 on [-1, 1]."""
    most = max(_at(c0, c1, c2, c3, -1.0), _at(c0, c1, c2, c3, 1.0))
    inner = c2 * c2 - 3.0 * c1 * c3
    if inner > 0.0:  # both roots of c1 + 2 c2 x + 3 c3 x^2, each without cancellation
        sum_ = -c2 - math.copysign(math.sqrt(inner), c2)
        one = c1 / sum_ if sum_ != 0.0 else 0.0
        other = sum_ / (3.0 * c3) if c3 != 0.0 else math.inf
        if abs(one) < 1.0:
            most = max(most, _at(c0, c1, c2, c3, one))
        if abs(other) < 1.0:
            most = max(most, _at(c0, c1, c2, c3, other))
    return most


@kernel(inline=True)
def _of_two(to_cubic, row, m0, s0, m1, s1):
    by = to_cubic[row]
    return by[0] * m0 + by[1] * s0 + by[2] * m1 + by[3] * s1


@kernel
def peak_force(mean, slope, to_cubic):
    """See plant.metrics.impacts.peak_force_n; `to_cubic`: coefficients from F_0, F_1 of two steps
    beside each other, shape (4, 4)."""
    highest, at, top, sloped = _highest(mean, slope)
    if not sloped or math.isnan(highest):
        return highest
    if mean.size < _WHOLE:
        return top
    most = -math.inf
    for i in range(max(at - 1, 1), min(at, mean.size - 3) + 1):
        m0, s0, m1, s1 = mean[i], slope[i], mean[i + 1], slope[i + 1]
        most = max(
            most,
            _largest(
                _of_two(to_cubic, 0, m0, s0, m1, s1),
                _of_two(to_cubic, 1, m0, s0, m1, s1),
                _of_two(to_cubic, 2, m0, s0, m1, s1),
                _of_two(to_cubic, 3, m0, s0, m1, s1),
            ),
        )
    return most if most > -math.inf else top


@kernel
def peak_size(values):
    """See hertzloop.plant.metrics.impacts.peak_speed_m_s."""
    at = fastest(values)
    size = abs(values[at])
    if not 0 < at < values.size - 1:
        return size
    sign = math.copysign(1.0, values[at])
    left, middle, right = sign * values[at - 1], sign * values[at], sign * values[at + 1]
    bend = left - 2.0 * middle + right
    return middle - (right - left) ** 2 / (8.0 * bend) if bend < 0.0 else size


# Indices into the metrics of a contact: its ends (steps of the run), speeds of the sphere before
# and after it (m/s, towards the plate and away), largest force (N) and speed of the plate (m/s).
BEGAN, ENDED, SPEED_IN, SPEED_OUT, PEAK, FASTEST = range(6)
METRICS = 6


@kernel(inline=True)
def _crossing(xi, before, dent):
    """Position of xi = -dent between `before` and the next step, in steps from `before` on."""
    a, b = xi[before] + dent, xi[before + 1] + dent
    return a / (a - b) if a != b else 0.0


@kernel(inline=True)
def _sphere_speed(xi_s, f_c, f_c1, at, mass, gravity, step_s):
    """Speed at the start of a step, up positive (m/s), exact for a force F + F_1 (2 t/h - 1):
    v = (x1 - x0)/h - ((F - F_1/3)/m - g) h/2."""
    held = (f_c[at] - f_c1[at] / 3.0) / mass - gravity
    return (xi_s[at + 1] - xi_s[at]) / step_s - 0.5 * held * step_s


@kernel
def contact_metrics(
    xi,
    xi_s,
    f_c,
    f_c1,
    v_p,
    dents,
    first_step,
    start,
    end,
    mass,
    gravity,
    step_s,
    to_cubic,
    metrics,
):
    """Metrics of the contact from row `start` to before `end`, which is -1 of one without an end;
    returns whether it has any. `dents` may be empty. See plant.metrics.impacts.impacts."""
    last, ends = xi.size - 1, end >= 0
    if not ends:
        end = last
    before, after = 0.0, 0.0
    if dents.size:
        before, after = dents[start], dents[end]
    cut_off = not ends or xi[end] <= -after
    enters = xi[start] > -before and start < last
    within = enters and not cut_off and end == start + 1
    began, ended = float(first_step + start), float(first_step + end)
    if enters and not within:
        began += _crossing(xi, start, before)
    if not cut_off and not within:
        ended = (first_step + end - 1) + _crossing(xi, end - 1, after)
    if ended <= began:
        return False  # began in the very last step of the run
    metrics[BEGAN], metrics[ENDED] = began, ended
    metrics[SPEED_IN] = -_sphere_speed(xi_s, f_c, f_c1, min(start, last - 1), mass, gravity, step_s)
    metrics[SPEED_OUT] = _sphere_speed(xi_s, f_c, f_c1, min(end, last - 1), mass, gravity, step_s)
    until = end + 1 if cut_off else end
    metrics[PEAK] = peak_force(f_c[start:until], f_c1[start:until], to_cubic)
    metrics[FASTEST] = peak_size(v_p[start : end + 1])
    return True


@kernel
def nonzero(values):
    """First index of what is not zero, and the one after the last; 0, 0 where all is."""
    first, end = 0, values.size
    while first < end and values[first] == 0.0:
        first += 1
    while end > first and values[end - 1] == 0.0:
        end -= 1
    return (first, end) if first < end else (0, 0)


class Spectra(NamedTuple):
    """What sums of samples become at the frequencies of oscillators.

    `powers`: real and imaginary part of z^n, z = exp(-i w h), for n up to a block's length, shape
    (2, block + 1, frequencies). Shapes (frequencies,): `held`, `tilted`: spectra of a mean of 1 and
    of a slope of 1 over a step; `contact`, `actuator`: values of the modes there.
    """

    powers: np.ndarray
    held: np.ndarray
    tilted: np.ndarray
    contact: np.ndarray
    actuator: np.ndarray


@kernel(allocates=True)
def add_spectrum(force, sign, powers, factor, found):
    """Add `factor` times the sum of `sign` F_n z^n to `found`; `powers` as in Spectra.

    In blocks, by Horner's rule: from power to power one would lose digits.
    """
    end = nonzero(force)[1]
    block = powers.shape[1] - 1
    blocks = -(-end // block)
    real, imaginary = np.empty(_AT_ONCE), np.empty(_AT_ONCE)
    for low in range(0, found.size if end else 0, _AT_ONCE):
        count = min(_AT_ONCE, found.size - low)
        re, im = real[:count], imaginary[:count]
        for j in range(count):
            re[j] = im[j] = 0.0
        turn_re, turn_im = powers[0, block, low : low + count], powers[1, block, low : low + count]
        for b in range(blocks - 1, -1, -1):
            for j in range(count):
                turned = re[j] * turn_re[j] - im[j] * turn_im[j]
                im[j] = re[j] * turn_im[j] + im[j] * turn_re[j]
                re[j] = turned
            start = b * block
            for n in range(min(block, end - start)):
                f = sign * force[start + n]
                if f == 0.0:
                    continue
                power_re, power_im = (
                    powers[0, n, low : low + count],
                    powers[1, n, low : low + count],
                )
                for j in range(count):
                    re[j] += f * power_re[j]
                    im[j] += f * power_im[j]
        for j in range(count):
            found[low + j] += factor[low + j] * complex(re[j], im[j])


@kernel(allocates=True)
def drive(contact_n, slope_n, sign, actuator_n, actuator_slope_n, by, found):
    """Phi_c F_c + Phi_a F_a of every oscillator into `found`; the contact's force is `sign` times
    what is given. See plant.metrics.noise.modal_drive."""
    part = np.zeros(found.size, np.complex128)
    add_spectrum(contact_n, sign, by.powers, by.held, part)
    add_spectrum(slope_n, sign, by.powers, by.tilted, part)
    for i in range(found.size):
        found[i] = by.contact[i] * part[i]
        part[i] = 0.0
    add_spectrum(actuator_n, 1.0, by.powers, by.held, part)
    add_spectrum(actuator_slope_n, 1.0, by.powers, by.tilted, part)
    for i in range(found.size):
        found[i] += by.actuator[i] * part[i]


class Reading(NamedTuple):
    """What the steps of an impact are read with. `mobility`: of what follows the forces at once,
    m/(N s); `impedance`: of an infinite plate, N s/m. Both nan where there is no such thing."""

    step_s: float
    mass_kg: float
    gravity_m_s2: float
    same_point: bool
    mobility: float
    impedance: float
    to_cubic: np.ndarray
    spectra: Spectra


@kernel(allocates=True)
def read_impact(
    xi,
    xi_s,
    v_p,
    f_c,
    f_a,
    xi_a,
    f_c1,
    f_a1,
    lead,
    count,
    continued,
    displaced,
    dents,
    first_step,
    by,
    metrics,
    work,
    speeds,
    found,
):
    """Read `count` steps of an impact, those after the first `lead`; some more may follow.

    Writes the `contact_metrics` of the first contact, or of its part where it is `continued`, the
    `work` of every step, and the drive of the oscillators into `found`; `speeds` is room. Without
    what was there before, a part begins at its own first row. Returns whether there is such a
    contact, the steps of `work` that belong to it, how many steps begin in contact, and the largest
    speed of the plate.
    """
    size, own = xi.size, slice(lead, lead + count)
    part = slice(lead if continued else 0, size)
    plate_work(
        displaced,
        xi_a,
        v_p,
        f_c,
        f_a,
        f_c1,
        f_a1,
        part.start,
        by.same_point,
        by.mobility,
        by.impedance,
        by.step_s,
        speeds,
        work,
    )
    start = part.start
    while start < size and f_c[start] == 0.0:
        start += 1
    end = start
    while end < size and f_c[end] != 0.0:
        end += 1
    until = end
    while until < size and f_c[until] == 0.0:
        until += 1
    known = (
        start < size
        and size - part.start > 2
        and contact_metrics(
            xi[part],
            xi_s[part],
            f_c[part],
            f_c1[part],
            v_p[part],
            dents[part],
            first_step,
            start - part.start,
            end - part.start if end < size else -1,
            by.mass_kg,
            by.gravity_m_s2,
            by.step_s,
            by.to_cubic,
            metrics,
        )
    )
    touching = 0
    while touching < count and f_c[lead + touching] != 0.0:
        touching += 1
    drive(f_c[own], f_c1[own], -1.0, f_a[own], f_a1[own], by.spectra, found)
    return known, start, until, touching, largest(v_p[own])


# A fingerprint of samples: 128 bits that chance does not repeat. It is no protection from intent.
_FOLD, _SHIFT = np.uint64(0x9E3779B97F4A7C15), np.uint64(29)


@kernel(inline=True)
def _fold(state, word):
    """Mix a word of 64 bits into a state of 64 bits, one to one."""
    mixed = (state ^ word) * _FOLD
    return mixed ^ (mixed >> _SHIFT)


@kernel(inline=True)
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


@kernel
def fingerprint(truth, samples):
    """Two words of 64 bits that tell truth, shape (columns, steps), and samples from others; both
    are arrays of words of 64 bits."""
    lanes = (np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4))
    for row in truth:
        lanes = _fold_all(row, lanes)
    a, b, c, d = _fold_all(samples, lanes)
    return _fold(_fold(a, b), _fold(c, d)), _fold(_fold(b, c), _fold(d, a))


# When an impact is over: the definition that all metrics of an impact rest on.
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


class ImpactFollower(NamedTuple):
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


def new_follower(
    quiet_steps: int, line_steps: int = 0, blur_m: float = math.inf, rest_n: float = 0.0
) -> ImpactFollower:
    """An impact before its first touch."""
    counts, widest_m = np.zeros(6, np.int64), np.full(1, -math.inf)
    return ImpactFollower(quiet_steps, line_steps, blur_m, counts, widest_m, rest_n)


NEVER = new_follower(-1)  # what a loop takes that does not end before its last step


@kernel(inline=True)
def is_silent(impact):
    """Whether nothing has touched or pushed for so long, and nothing from before is on its way."""
    counts = impact.counts
    return counts[LEFT] == 1 and counts[STEP] - counts[BUSY] >= impact.quiet_steps


@kernel(inline=True)
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


@kernel(inline=True)
def keeps(impact, level, value):
    """Whether a promise of no force while samples stay above `level` holds until the sphere has
    come back; `value`: the latest sample."""
    below = level + impact.blur_m < _BACK * impact.widest_m[0]
    return value > level and (level == -math.inf or below)
