"""Impacts of a run, from its truth: the metrics that `run` and `inspect` print."""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop.plant.contact.yielding import dents_m, elastic_n
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.modal import (
    impedance_n_s_m,
    residual_mobility_m_ns,
    series_residual_m_n,
)
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.time_series import DEEPEST, F_A, F_A1, F_C, F_C1, V_P, XI, XI_A, XI_P, XI_S

_WHOLE = 4  # steps that a contact has at least, for two whole ones beside each other
_FEW_STEPS = 2  # no contact is read from so few
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
            of this contact until the impact is over (`impact_kernels`; in `impacts_in` until the
            next contact or the end of the time series).
        plate_speed_max_m_s: largest plate speed at the contact point, m/s.
    """

    start_s: float
    duration_s: float
    impact_speed_m_s: float
    rebound_speed_m_s: float
    peak_force_n: float
    plate_energy_j: float
    plate_speed_max_m_s: float


def contacts(f_c: np.ndarray) -> tuple[list[int], list[int]]:
    """First steps of the contacts, and of what follows them; none after one that is cut off."""
    touching = f_c != 0.0
    edges = (np.flatnonzero(touching[1:] != touching[:-1]) + 1).tolist()
    if len(touching) and touching[0]:
        edges.insert(0, 0)
    return edges[::2], edges[1::2]


def _moments() -> np.ndarray:
    nodes, weights = np.polynomial.legendre.leggauss(4)
    truth = []
    for middle in (-0.5, 0.5):
        powers = (middle + 0.5 * nodes)[:, None] ** _POWERS
        truth += [0.5 * weights @ powers, 1.5 * (weights * nodes) @ powers]
    return np.array(truth)


TO_CUBIC = np.linalg.inv(_moments())


def peak_force_n(mean_n: np.ndarray, slope_n: np.ndarray) -> float:
    """Largest force of one contact within its steps, N, from F_0 and F_1 of every step.

    Of the cubic that has both of two neighbouring steps, order 4: the means are low by the
    curvature, and the ends of the steps' own lines miss by as much to either side. Without slopes,
    or of so short a contact that no two steps are whole, the largest value of these.
    """
    at = int(np.argmax(mean_n))
    if not slope_n.any():
        return float(mean_n[at])
    ends = float(np.max(mean_n + np.abs(slope_n)))
    if len(mean_n) < _WHOLE or not math.isfinite(ends):
        return ends
    pairs = [slice(i, i + 2) for i in range(max(at - 1, 1), min(at, len(mean_n) - 3) + 1)]
    return max((_largest_of_cubic(mean_n[i], slope_n[i]) for i in pairs), default=ends)


def _largest_of_cubic(mean_n: np.ndarray, slope_n: np.ndarray) -> float:
    """Largest value over two steps of the cubic with their F_0 and F_1, N."""
    c0, c1, c2, c3 = (TO_CUBIC @ np.ravel([mean_n, slope_n], "F")).tolist()
    at = [-1.0, 1.0]
    root = math.sqrt(max(c2 * c2 - 3.0 * c1 * c3, 0.0))
    q = -c2 - math.copysign(root, c2)  # both roots of c1 + 2 c2 x + 3 c3 x^2, without cancellation
    for up, down in ((c1, q), (q, 3.0 * c3)):
        if abs(up) < abs(down):
            at.append(up / down)
    return max(c0 + x * (c1 + x * (c2 + x * c3)) for x in at)


def peak_speed_m_s(speed_m_s: np.ndarray) -> float:
    """Largest size of a speed that is known at the ends of steps, also between them: the vertex of
    the parabola through the three values around it."""
    size = np.abs(speed_m_s)
    at = int(np.argmax(size))
    if not 0 < at < len(size) - 1:
        return float(size[at])
    left, middle, right = (math.copysign(1.0, speed_m_s[at]) * speed_m_s[at - 1 : at + 2]).tolist()
    bend = left - 2.0 * middle + right
    return float(middle - (right - left) ** 2 / (8.0 * bend) if bend < 0.0 else middle)


def modal_displacement(spec: PlantSpec, truth: np.ndarray) -> np.ndarray:
    """Displacement at the contact point without that of the modes left out, a spring between the
    present contact force and the actuator force of the step before. It takes no energy."""
    spring = series_residual_m_n(spec)
    if spring == 0.0:
        return truth[XI_P]
    contact_n = elastic_n(spec.contact, -truth[XI], truth[DEEPEST])
    before = np.concatenate([[0.0], truth[F_A, :-1] + truth[F_A1, :-1]])
    actuator_n = before if spec.same_point else 0.0
    return np.asarray(truth[XI_P] - spring * (actuator_n - contact_n))


def impacts_in(spec: PlantSpec, truth: np.ndarray) -> list[Impact]:
    """Contact metrics of every impact from truth (COLUMNS, steps) alone, each to the start of
    the next one or the end of the steps; see `first_contact`."""
    starts = contacts(truth[F_C])[0]
    found = []
    for start, following in zip(starts, [*starts[1:], truth.shape[1]], strict=False):
        before = max(start - 1, 0)
        found.append(first_contact(spec, truth[:, before : following + 1], before))
    return [one for one in found if one]


def first_contact(spec: PlantSpec, truth: np.ndarray, first_step: int) -> Impact | None:
    """Metrics of the first contact in truth (COLUMNS, steps) whose first column is that step of the
    run; None without a contact.

    A contact that the end cuts off counts with what there is of it, if there is any; one within
    one step with the whole step. Work counts until the next contact.
    """
    starts, ends = contacts(truth[F_C])
    last = truth.shape[1] - 1
    if last < _FEW_STEPS or not starts or starts[0] == last:
        return None
    xi, start, end = truth[XI], starts[0], ends[0] if ends else last
    dents = dents_m(spec.contact, truth[DEEPEST, [start, end]])
    before, after = (0.0, 0.0) if dents is None else dents.tolist()
    cut_off = not ends or xi[end] <= -after
    enters = xi[start] > -before
    began, ended = float(first_step + start), float(first_step + end)
    if cut_off or not enters or end > start + 1:
        if enters:
            began += _crossing(xi[start : start + 2] + before)
        if not cut_off:
            ended += _crossing(xi[end - 1 : end + 1] + after) - 1.0
    if ended <= began:  # began in the very last step
        return None
    steps = slice(start, end + 1 if cut_off else end)
    work_j = step_work_j(spec, truth)[start : starts[1] if len(starts) > 1 else None]
    return Impact(
        start_s=began * spec.step_s,
        duration_s=(ended - began) * spec.step_s,
        impact_speed_m_s=-_sphere_speed_m_s(spec, truth, start),
        rebound_speed_m_s=_sphere_speed_m_s(spec, truth, min(end, last - 1)),
        peak_force_n=peak_force_n(truth[F_C, steps], truth[F_C1, steps]),
        plate_energy_j=float(work_j.sum()),
        plate_speed_max_m_s=peak_speed_m_s(truth[V_P, start : end + 1]),
    )


def _crossing(gap: np.ndarray) -> float:
    """Where a gap is zero between two steps, in steps from the first on."""
    a, b = gap.tolist()
    return a / (a - b) if a != b else 0.0


def _sphere_speed_m_s(spec: PlantSpec, truth: np.ndarray, at: int) -> float:
    """Speed at the start of a step, up positive, exact for a force F + F_1 (2 t/h - 1):
    v = (x1 - x0)/h - ((F - F_1/3)/m - g) h/2."""
    held = (truth[F_C, at] - truth[F_C1, at] / 3.0) / spec.sphere.mass_kg - GRAVITY_M_S2
    moved = truth[XI_S, at + 1] - truth[XI_S, at]
    return float(moved / spec.step_s - 0.5 * held * spec.step_s)


def step_work_j(spec: PlantSpec, truth: np.ndarray) -> np.ndarray:
    """Work of contact and actuator force on the plate over every step, the last zero; J, (steps,).

    Where a force changes over a step, F_1 adds F_1 h (v_1 - v_0)/6 by Hermite's mean of the
    displacement; on an infinite plate, where v = F/Z, F_1^2 h/(3 Z). Of an actuator elsewhere, the
    velocity is taken from its places.
    """
    h, displaced = spec.step_s, modal_displacement(spec, truth)
    f_c, f_a, f_c1, f_a1, v_p = truth[[F_C, F_A, F_C1, F_A1, V_P]]
    # Where something follows the forces at once, the velocity jumps with that of the actuator.
    starts = v_p.copy()
    if spec.same_point:
        jump = (f_a - f_a1)[1:] - (f_a + f_a1)[:-1]
        starts[1:] += residual_mobility_m_ns(spec) * jump
    change = v_p[1:] - starts[:-1]
    place = displaced if spec.same_point else truth[XI_A]
    work = np.zeros(len(f_c))
    work[:-1] = f_a[:-1] * np.diff(place) - f_c[:-1] * np.diff(displaced)
    if spec.infinite_plate:
        work[:-1] += f_c1[:-1] ** 2 * h / (3.0 * impedance_n_s_m(spec.local_plate))
    else:
        work[:-1] -= f_c1[:-1] * change * h / 6.0
    if f_a1[:-1].any():
        if not spec.same_point:
            change = np.diff(np.gradient(truth[XI_A], h))
        work[:-1] += f_a1[:-1] * change * h / 6.0
    return work
