"""Impacts of a run, from its rows of truth: the figures that `run` and `inspect` print."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hertzloop.jit import kernel
from hertzloop.plant.contact.yielding import dents_m, elastic_n
from hertzloop.plant.figures import rows_kernels as rows_k
from hertzloop.plant.figures.noise import Spectra, drive_into
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.collocation import damped_tail, flexibility_m_n
from hertzloop.plant.schemes.infinite import impedance_n_s_m
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.time_series import DEEPEST, F_A, F_A1, F_C, F_C1, V_P, XI, XI_A, XI_P, XI_S

_FEW_EDGES = 64  # starts and ends of contacts; of a run with more they are counted first
# Means F_0 and first moments F_1 of x^0 ... x^3 over the steps [-1, 0] and [0, 1], where over
# each step F is F_0 + F_1 P, P from -1 to 1: F_1 is 3 times the mean of F P.
_POWERS = np.arange(4)


@dataclass(frozen=True)
class Impact:
    """One contact.

    Times are found between two steps by linear interpolation of the gap. Peak force and plate
    speed are maxima within steps (the published scheme: at its samples, as published).

    Attributes:
        start_s: start of the contact since the start of the run, s.
        duration_s: contact time, s.
        impact_speed_m_s: speed of the sphere at the start, positive downwards, m/s.
        rebound_speed_m_s: speed of the sphere at the end, positive upwards, m/s.
        peak_force_n: largest contact force, N.
        plate_energy_j: work of contact force and actuator force on the plate, J, from the start
            of this contact until the impact is over (`rows_kernels`; in `impacts` below until
            the next contact or the end of the time series).
        plate_speed_max_m_s: largest plate speed at the contact point, m/s.
    """

    start_s: float
    duration_s: float
    impact_speed_m_s: float
    rebound_speed_m_s: float
    peak_force_n: float
    plate_energy_j: float
    plate_speed_max_m_s: float


_WHOLE = 4  # steps that a contact has at least, for two whole ones beside each other


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


@kernel(inline=True, borrowed=True)
def _add_work_of_slopes(slope, v_end, v_start, sign, step_s, work):
    """Add the work of the slopes, `sign` F_1 h (v_1 - v_0)/6."""
    for i in range(work.size - 1):
        work[i] += sign * slope[i] * (v_end[i + 1] - v_start[i]) * step_s / 6.0


@kernel(inline=True, borrowed=True)
def _gradient(values, at, step_s):
    """Derivative of values `step_s` apart, by central differences."""
    if at == 0:
        return (values[1] - values[0]) / step_s
    if at == values.size - 1:
        return (values[at] - values[at - 1]) / step_s
    return (values[at + 1] - values[at - 1]) / (2.0 * step_s)


@kernel(borrowed=True)
def step_work(xi_p, f_c, f_a, xi_a, f_c1, f_a1, v_p, v_start, step_s, impedance, same_point, work):
    """See `step_work_j`; `impedance` is nan, and arrays that are not known are
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
    if f_a1.size == 0 or v_start.size == 0 or work.size == 1 or rows_k.nonzero(f_a1)[1] == 0:
        return
    if same_point:
        _add_work_of_slopes(f_a1, v_p, v_start, 1.0, step_s, work)
        return
    for i in range(work.size - 1):
        change = _gradient(xi_a, i + 1, step_s) - _gradient(xi_a, i, step_s)
        work[i] += f_a1[i] * change * step_s / 6.0


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


@kernel(inline=True, borrowed=True)
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


@kernel(inline=True, borrowed=True)
def _at(c0, c1, c2, c3, x):
    return c0 + x * (c1 + x * (c2 + x * c3))


@kernel(inline=True, borrowed=True)
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


@kernel(inline=True, borrowed=True)
def _of_two(to_cubic, row, m0, s0, m1, s1):
    by = to_cubic[row]
    return by[0] * m0 + by[1] * s0 + by[2] * m1 + by[3] * s1


@kernel(borrowed=True)
def peak_force(mean, slope, to_cubic):
    """See `peak_force_n`; `to_cubic`: coefficients from F_0, F_1 of two steps
    beside each other, shape (4, 4)."""
    highest, at, top, sloped = _highest(mean, slope)
    if not sloped or math.isnan(highest):
        return highest
    if mean.size < _WHOLE:
        return top
    most = -math.inf
    for i in range(max(at - 1, 1), min(at, mean.size - 3) + 1):
        m0, s0, m1, s1 = mean[i], slope[i], mean[i + 1], slope[i + 1]
        most = max(most, _largest(
            _of_two(to_cubic, 0, m0, s0, m1, s1), _of_two(to_cubic, 1, m0, s0, m1, s1),
            _of_two(to_cubic, 2, m0, s0, m1, s1), _of_two(to_cubic, 3, m0, s0, m1, s1),
        ))  # fmt: skip
    return most if most > -math.inf else top


@kernel(borrowed=True)
def peak_size(values):
    """See `peak_speed_m_s`."""
    at = rows_k.fastest(values)
    size = abs(values[at])
    if not 0 < at < values.size - 1:
        return size
    sign = math.copysign(1.0, values[at])
    left, middle, right = sign * values[at - 1], sign * values[at], sign * values[at + 1]
    bend = left - 2.0 * middle + right
    return middle - (right - left) ** 2 / (8.0 * bend) if bend < 0.0 else size


# Indices into the figures of a contact: its ends (steps of the run), speeds of the sphere before
# and after it (m/s, towards the plate and away), largest force (N) and speed of the plate (m/s).
BEGAN, ENDED, SPEED_IN, SPEED_OUT, PEAK, FASTEST = range(6)
FIGURES = 6


@kernel(inline=True, borrowed=True)
def _crossing(xi, before, dent):
    """Position of xi = -dent between `before` and the next step, in steps from `before` on."""
    a, b = xi[before] + dent, xi[before + 1] + dent
    return a / (a - b) if a != b else 0.0


@kernel(inline=True, borrowed=True)
def _sphere_speed(xi_s, f_c, f_c1, at, mass, gravity, step_s):
    """Speed at the start of a step, up positive (m/s), exact for a force F + F_1 (2 t/h - 1):
    v = (x1 - x0)/h - ((F - F_1/3)/m - g) h/2."""
    held = (f_c[at] - f_c1[at] / 3.0) / mass - gravity
    return (xi_s[at + 1] - xi_s[at]) / step_s - 0.5 * held * step_s


@kernel(borrowed=True)
def contact_figures(
    xi, xi_s, f_c, f_c1, v_p, dents, first_step, start, end, mass, gravity, step_s, to_cubic,
    figures,
):  # fmt: skip
    """Figures of the contact from row `start` to before `end`, which is -1 of one without an end;
    returns whether it has any. `dents` may be empty. See `impacts`."""
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
    figures[BEGAN], figures[ENDED] = began, ended
    figures[SPEED_IN] = -_sphere_speed(xi_s, f_c, f_c1, min(start, last - 1), mass, gravity, step_s)
    figures[SPEED_OUT] = _sphere_speed(xi_s, f_c, f_c1, min(end, last - 1), mass, gravity, step_s)
    until = end + 1 if cut_off else end
    figures[PEAK] = peak_force(f_c[start:until], f_c1[start:until], to_cubic)
    figures[FASTEST] = peak_size(v_p[start : end + 1])
    return True


class Reading(NamedTuple):
    """What the rows of an impact are read with. `mobility`: of what follows the forces at once,
    m/(N s); `impedance`: of an infinite plate, N s/m. Both nan where there is no such thing."""

    step_s: float
    mass_kg: float
    gravity_m_s2: float
    same_point: bool
    mobility: float
    impedance: float
    to_cubic: np.ndarray
    spectra: Spectra


@kernel(released=True)
def read_impact(
    xi, xi_s, v_p, f_c, f_a, xi_a, f_c1, f_a1, lead, count, continued, displaced, dents, first_step,
    by, figures, work, speeds, found,
):  # fmt: skip
    """Read `count` rows of an impact, those after the first `lead`; some more may follow.

    Writes the `contact_figures` of the first contact, or of its part where it is `continued`, the
    `work` of every step, and the drive of the oscillators into `found`; `speeds` is room. Without
    what was there before, a part begins at its own first row. Returns whether there is such a
    contact, the rows of `work` that belong to it, how many rows begin in contact, and the largest
    speed of the plate.
    """
    size, own, same = xi.size, slice(lead, lead + count), by.same_point
    if not math.isnan(by.mobility):
        starting_speeds(v_p, f_c, f_c1, f_a, f_a1, same, by.mobility, speeds)
    else:
        speeds[:] = v_p
    part = slice(lead if continued else 0, size)
    place = displaced[part] if same else xi_a[part]
    step_work(
        displaced[part], f_c[part], f_a[part], place, f_c1[part], f_a1[part], v_p[part],
        speeds[part], by.step_s, by.impedance, same, work[part],
    )  # fmt: skip
    start = part.start
    while start < size and f_c[start] == 0.0:
        start += 1
    end = start
    while end < size and f_c[end] != 0.0:
        end += 1
    until = end
    while until < size and f_c[until] == 0.0:
        until += 1
    known = start < size and size - part.start > 2 and contact_figures(
        xi[part], xi_s[part], f_c[part], f_c1[part], v_p[part], dents[part], first_step,
        start - part.start, end - part.start if end < size else -1, by.mass_kg, by.gravity_m_s2,
        by.step_s, by.to_cubic, figures,
    )  # fmt: skip
    touching = 0
    while touching < count and f_c[lead + touching] != 0.0:
        touching += 1
    drive_into(f_c[own], f_c1[own], -1.0, f_a[own], f_a1[own], by.spectra, found)
    return known, start, until, touching, rows_k.largest(v_p[own])


def contacts(f_c: np.ndarray) -> tuple[list[int], list[int]]:
    """First steps of the contacts, and of what follows them; none after one that is cut off."""
    edges = np.empty(_FEW_EDGES, np.int64)
    count = edges_of(f_c, edges)
    if count > len(edges):
        edges = np.empty(count, np.int64)
        edges_of(f_c, edges)
    return edges[:count:2].tolist(), edges[1:count:2].tolist()


def step_work_j(
    xi_p: np.ndarray,
    f_c: np.ndarray,
    f_a: np.ndarray,
    xi_a: np.ndarray,
    f_c1: np.ndarray,
    v_p: np.ndarray | None,
    step_s: float,
    impedance_n_s_m: float | None,
    f_a1: np.ndarray | None = None,
    same_point: bool = True,
    v_start: np.ndarray | None = None,
) -> np.ndarray:
    """Work of contact and actuator force on the plate over every step, the last zero; J, shape
    (steps,). See `impacts`."""
    unknown = np.zeros(0)
    v_p = unknown if v_p is None else v_p
    work = np.empty(len(xi_p))
    step_work(
        xi_p, f_c, f_a, xi_a, f_c1, unknown if f_a1 is None else f_a1, v_p,
        v_p if v_start is None else v_start, step_s,
        math.nan if impedance_n_s_m is None else impedance_n_s_m, same_point, work,
    )  # fmt: skip
    return work


def impacts(
    xi: np.ndarray,
    xi_s: np.ndarray,
    xi_p: np.ndarray,
    f_c: np.ndarray,
    f_a: np.ndarray,
    xi_a: np.ndarray | None,
    mass_kg: float,
    step_s: float,
    f_c1: np.ndarray | None = None,
    v_p: np.ndarray | None = None,
    impedance_n_s_m: float | None = None,
    first_step: int = 0,
    f_a1: np.ndarray | None = None,
    dent_m: np.ndarray | None = None,
    v_start: np.ndarray | None = None,
    gravity_m_s2: float = GRAVITY_M_S2,
) -> list[Impact]:
    """All impacts of a run from its rows of truth (arrays of shape (steps,)).

    `xi_a` is the displacement at the actuator, None where that is the contact point. Where the
    contact force changes over a step, by `f_c1`, the plate velocity `v_p` is needed for the
    work of that part, F_1 h (v_1 - v_0)/6 by Hermite's mean of the displacement; `v_start`: that
    velocity under the forces of the step that begins, where it follows them at once. On an infinite
    plate of `impedance_n_s_m`, v = F/Z, it is F_1^2 h/(3 Z). `f_a1`: the same of the actuator's
    force; at a point of its own the velocity is taken from its places. A contact that the run's
    end cuts off counts with what there is of it, if there is any. `first_step`: step of the
    first row. A contact within one step counts with the whole step. `dent_m`: of a contact that
    yields, at every step: there is contact below it.
    """
    if len(xi) < 3:
        return []
    starts, ends = contacts(f_c)
    if not starts:
        return []
    slope = np.zeros(len(xi)) if f_c1 is None else f_c1
    speeds = np.zeros(len(xi)) if v_p is None else v_p
    at_actuator = xi_p if xi_a is None else xi_a
    work = step_work_j(
        xi_p, f_c, f_a, at_actuator, slope, v_p, step_s, impedance_n_s_m, f_a1, xi_a is None,
        v_start,
    )  # fmt: skip
    dents, figures, found = np.zeros(0) if dent_m is None else dent_m, np.empty(FIGURES), []
    for i, start in enumerate(starts):
        end = ends[i] if i < len(ends) else -1
        if contact_figures(
            xi, xi_s, f_c, slope, speeds, dents, first_step, start, end, mass_kg, gravity_m_s2,
            step_s, TO_CUBIC, figures,
        ):  # fmt: skip
            until = starts[i + 1] if i + 1 < len(starts) else len(xi)
            found.append(impact_of(figures, step_s, float(work[start:until].sum())))
    return found


def impact_of(figures: np.ndarray, step_s: float, work_j: float) -> Impact:
    """The impact whose contact has some `contact_figures`, and that takes `work_j` (J)."""
    began, ended, speed_in, speed_out, peak_n, fastest = figures.tolist()
    return Impact(
        start_s=began * step_s,
        duration_s=(ended - began) * step_s,
        impact_speed_m_s=speed_in,
        rebound_speed_m_s=speed_out,
        peak_force_n=peak_n,
        plate_energy_j=work_j,
        plate_speed_max_m_s=fastest,
    )


def _moments() -> np.ndarray:
    nodes, weights = np.polynomial.legendre.leggauss(4)
    rows = []
    for middle in (-0.5, 0.5):
        powers = (middle + 0.5 * nodes)[:, None] ** _POWERS
        rows += [0.5 * weights @ powers, 1.5 * (weights * nodes) @ powers]
    return np.array(rows)


TO_CUBIC = np.linalg.inv(_moments())


def peak_force_n(mean_n: np.ndarray, slope_n: np.ndarray) -> float:
    """Largest force of one contact within its steps, N, from F_0 and F_1 of every step.

    Of the cubic that has both of two neighbouring steps, order 4: the means are low by the
    curvature, and the ends of the steps' own lines miss by as much to either side. Without slopes,
    or of so short a contact that no two steps are whole, the largest value of these.
    """
    return float(peak_force(mean_n, slope_n, TO_CUBIC))


def peak_speed_m_s(speed_m_s: np.ndarray) -> float:
    """Largest size of a speed that is known at the ends of steps, also between them: the vertex of
    the parabola through the three values around it."""
    return float(peak_size(speed_m_s))


class ImpactPart(NamedTuple):
    """What `read_impact` finds and writes."""

    known: bool
    start: int
    until: int
    touching: int
    speed_max_m_s: float
    figures: np.ndarray
    work_j: np.ndarray
    drive: np.ndarray

    def impact(self, step_s: float) -> Impact:
        """The contact that is known, with the work on the plate that belongs to it."""
        return impact_of(self.figures, step_s, float(self.work_j[self.start : self.until].sum()))


def modal_displacement(spec: PlantSpec, rows: np.ndarray) -> np.ndarray:
    """Displacement at the struck point without that of the modes left out, a spring between the
    present contact force and the actuator force of the step before. It takes no energy."""
    spring = flexibility_m_n(spec)
    if spring == 0.0:
        return rows[XI_P]
    contact_n = elastic_n(spec.contact, -rows[XI], rows[DEEPEST])
    before = np.concatenate([[0.0], rows[F_A, :-1] + rows[F_A1, :-1]])
    actuator_n = before if spec.same_point else 0.0
    return np.asarray(rows[XI_P] - spring * (actuator_n - contact_n))


def starting_speed(spec: PlantSpec, rows: np.ndarray) -> np.ndarray:
    """Velocity of the struck point right at the start of every step, under its forces, m/s: the
    part of a damped tail follows them at once. In the first row it is that of the row."""
    tail = damped_tail(spec)[0]
    if tail is None:
        return rows[V_P]
    found = np.empty(rows.shape[1])
    if len(found):
        starting_speeds(
            rows[V_P], rows[F_C], rows[F_C1], rows[F_A], rows[F_A1], spec.same_point,
            tail.mobility_m_ns, found,
        )  # fmt: skip
    return found


def impacts_in(
    spec: PlantSpec, rows: np.ndarray, displaced: np.ndarray, v_start: np.ndarray,
    first_step: int = 0,
) -> list[Impact]:  # fmt: skip
    """Contact figures of every impact from rows (10, steps), `modal_displacement` and
    `starting_speed` of them."""
    same = spec.same_point
    return impacts(
        rows[XI], rows[XI_S], displaced, rows[F_C], rows[F_A], None if same else rows[XI_A],
        spec.sphere.mass_kg, spec.step_s, f_c1=rows[F_C1], v_p=rows[V_P],
        impedance_n_s_m=impedance_n_s_m(spec.local_plate) if spec.infinite_plate else None,
        first_step=first_step, f_a1=rows[F_A1],
        dent_m=dents_m(spec.contact, rows[DEEPEST]), v_start=v_start,
        gravity_m_s2=spec.sphere.gravity_m_s2,
    )  # fmt: skip


def work_j(spec: PlantSpec, rows: np.ndarray, displaced: np.ndarray, v_start: np.ndarray) -> float:
    """Work of both forces on the plate over rows (10, steps), J."""
    same = spec.same_point
    impedance = impedance_n_s_m(spec.local_plate) if spec.infinite_plate else None
    work = step_work_j(
        displaced, rows[F_C], rows[F_A], displaced if same else rows[XI_A], rows[F_C1],
        rows[V_P], spec.step_s, impedance, rows[F_A1], same, v_start,
    )  # fmt: skip
    return float(work.sum())
