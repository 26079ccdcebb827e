"""Compiled passes over a run's steps, arrays (steps,), for the metrics of impacts."""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel
from hertzloop.plant.metrics.spectrum_kernels import nonzero

_WHOLE = 4  # steps that a contact has at least, for two whole ones beside each other


class TruthColumns(NamedTuple):
    """Steps of a run, one value each. Columns of the time series are called as in `time_series`.

    `displaced`: see plant.metrics.impacts.modal_displacement, m. `dents`: depth of the dent, m;
    empty where nothing yields.
    """

    xi: np.ndarray
    xi_s: np.ndarray
    v_p: np.ndarray
    f_c: np.ndarray
    f_a: np.ndarray
    xi_a: np.ndarray
    f_c1: np.ndarray
    f_a1: np.ndarray
    displaced: np.ndarray
    dents: np.ndarray


class Reading(NamedTuple):
    """What the steps of a plant are read with. `mobility`: of what follows the forces at once,
    m/(N s); `impedance`: of an infinite plate, N s/m, nan of another."""

    step_s: float
    mass_kg: float
    gravity_m_s2: float
    same_point: bool
    mobility: float
    impedance: float
    to_cubic: np.ndarray


@kernel
def _starting_speeds(columns, by, speeds):
    """Write the velocity of the plate at the start of every step.

    Where something follows the forces at once, the velocity jumps with that of the actuator. The
    first row keeps its own.
    """
    v_p, f_a, f_a1 = columns.v_p, columns.f_a, columns.f_a1
    speeds[0] = v_p[0]
    at_once = by.mobility if by.same_point else 0.0
    for i in range(1, v_p.size):
        jump = (f_a[i] - f_a1[i]) - (f_a[i - 1] + f_a1[i - 1])
        speeds[i] = v_p[i] + at_once * jump


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
def plate_work(columns, first, by, speeds, work):
    """Write the work of every step from `first` on; see plant.metrics.impacts.step_work_j.

    `speeds` is room of the size of `work`.
    """
    _starting_speeds(columns, by, speeds)
    last, part = work.size - 1, slice(first, work.size)
    if first > last:
        return
    displaced, f_c, f_a = columns.displaced, columns.f_c, columns.f_a
    place = displaced if by.same_point else columns.xi_a
    work[last] = 0.0
    for i in range(first, last):
        work[i] = -f_c[i] * (displaced[i + 1] - displaced[i]) + f_a[i] * (place[i + 1] - place[i])
    f_c1, f_a1, v_p = columns.f_c1[part], columns.f_a1[part], columns.v_p[part]
    if not math.isnan(by.impedance):
        for i in range(f_c1.size - 1):
            work[first + i] += f_c1[i] * f_c1[i] * by.step_s / (3.0 * by.impedance)
    else:
        _add_work_of_slopes(f_c1, v_p, speeds[part], -1.0, by.step_s, work[part])
    if first == last or nonzero(f_a1)[1] == 0:
        return
    if by.same_point:
        _add_work_of_slopes(f_a1, v_p, speeds[part], 1.0, by.step_s, work[part])
        return
    xi_a = columns.xi_a[part]
    for i in range(f_a1.size - 1):
        change = _gradient(xi_a, i + 1, by.step_s) - _gradient(xi_a, i, by.step_s)
        work[first + i] += f_a1[i] * change * by.step_s / 6.0


@kernel
def fastest(values):
    """Index of the largest size; of the first that is not a number, if there is one."""
    at = 0
    for i in range(values.size):
        size = abs(values[i])
        if math.isnan(size):
            return i
        if size > abs(values[at]):
            at = i
    return at


@kernel
def largest(values):
    """Largest size; no number where one is none, zero of no values."""
    return abs(values[fastest(values)]) if values.size else 0.0


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
def _sphere_speed(columns, at, by):
    """Speed at the start of a step, up positive (m/s), exact for a force F + F_1 (2 t/h - 1):
    v = (x1 - x0)/h - ((F - F_1/3)/m - g) h/2."""
    xi_s, f_c, f_c1 = columns.xi_s, columns.f_c, columns.f_c1
    held = (f_c[at] - f_c1[at] / 3.0) / by.mass_kg - by.gravity_m_s2
    return (xi_s[at + 1] - xi_s[at]) / by.step_s - 0.5 * held * by.step_s


@kernel
def contact_metrics(columns, first_step, start, end, by, metrics):
    """Write the metrics of the contact from row `start` to before `end`; return whether it has any.

    `end` is -1 for a contact without an end. `first_step`: step of the run in row 0. See
    plant.metrics.impacts.impacts_in.
    """
    xi, f_c, dents = columns.xi, columns.f_c, columns.dents
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
    metrics[SPEED_IN] = -_sphere_speed(columns, min(start, last - 1), by)
    metrics[SPEED_OUT] = _sphere_speed(columns, min(end, last - 1), by)
    until = end + 1 if cut_off else end
    metrics[PEAK] = peak_force(f_c[start:until], columns.f_c1[start:until], by.to_cubic)
    metrics[FASTEST] = peak_size(columns.v_p[start : end + 1])
    return True
