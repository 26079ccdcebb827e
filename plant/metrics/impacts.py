"""Impacts of a run, from its truth: the metrics that `run` and `inspect` print."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hertzloop.plant.contact.yielding import dents_m, elastic_n
from hertzloop.plant.metrics import spectrum_kernels, truth_kernels
from hertzloop.plant.metrics.noise import NoiseInputs, spectra_of
from hertzloop.plant.metrics.truth_kernels import METRICS
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.modal import (
    impedance_n_s_m,
    residual_mobility_m_ns,
    series_residual_m_n,
)
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.modes import Oscillators
from hertzloop.plant.time_series import DEEPEST, F_A, F_A1, F_C, F_C1, V_P, XI, XI_P

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


def impact_of(metrics: np.ndarray, step_s: float, work_j: float) -> Impact:
    """The impact whose contact has some `contact_metrics`, and that takes `work_j` (J)."""
    began, ended, speed_in, speed_out, peak_n, fastest = metrics.tolist()
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
    return float(truth_kernels.peak_force(mean_n, slope_n, TO_CUBIC))


def peak_speed_m_s(speed_m_s: np.ndarray) -> float:
    """Largest size of a speed that is known at the ends of steps, also between them: the vertex of
    the parabola through the three values around it."""
    return float(truth_kernels.peak_size(speed_m_s))


class ImpactPart(NamedTuple):
    """A contact (None where there is too little of it) and how many steps it has; the largest speed
    of the plate (m/s) and the drive of the oscillators (N s) until the impact is over."""

    impact: Impact | None
    touching: int
    speed_max_m_s: float
    drive: np.ndarray


def noise_inputs(impact: Impact, drive: np.ndarray, plate_speed_max_m_s: float) -> NoiseInputs:
    """What the noise metrics of one impact follow from; `drive` and `plate_speed_max_m_s` over all
    steps of the impact."""
    return NoiseInputs(
        drive,
        impact.plate_energy_j,
        plate_speed_max_m_s,
        impact.duration_s,
        impact.impact_speed_m_s,
        impact.rebound_speed_m_s,
    )


def part_of(
    spec: PlantSpec, modes: Oscillators, truth: np.ndarray, own: slice, first_step: int
) -> ImpactPart:
    """Read an impact from truth, shape (COLUMNS, steps), from step `first_step` of the run on.

    `own`: the steps of the impact, the first in contact; one before it and some after it may be
    there as well.
    """
    starts, ends = contacts(truth[F_C])
    f_c, f_c1, f_a, f_a1, v_p = truth[[F_C, F_C1, F_A, F_A1, V_P], own]
    drive = np.empty(len(modes.omega), complex)
    spectrum_kernels.drive(f_c, f_c1, -1.0, f_a, f_a1, spectra_of(modes, spec.step_s), drive)
    touching = int(np.argmin(np.append(f_c != 0.0, False)))
    metrics, found = np.empty(METRICS), None
    if starts and truth.shape[1] > _FEW_STEPS:
        start, end = starts[0], ends[0] if ends else -1
        columns, by = _columns(spec, truth), _reading(spec)
        if truth_kernels.contact_metrics(columns, first_step, start, end, by, metrics):
            until = starts[1] if len(starts) > 1 else truth.shape[1]
            work_j = _step_work_j(columns, by, 0)[start:until].sum()
            found = impact_of(metrics, spec.step_s, float(work_j))
    return ImpactPart(found, touching, float(truth_kernels.largest(v_p)), drive)


@lru_cache(maxsize=16)
def _reading(spec: PlantSpec) -> truth_kernels.Reading:
    return truth_kernels.Reading(
        step_s=spec.step_s,
        mass_kg=spec.sphere.mass_kg,
        gravity_m_s2=GRAVITY_M_S2,
        same_point=spec.same_point,
        mobility=residual_mobility_m_ns(spec),
        impedance=impedance_n_s_m(spec.local_plate) if spec.infinite_plate else math.nan,
        to_cubic=TO_CUBIC,
    )


def _columns(spec: PlantSpec, truth: np.ndarray) -> truth_kernels.TruthColumns:
    xi, xi_s, _, v_p, f_c, f_a, xi_a, f_c1, f_a1, deepest = truth
    dents = dents_m(spec.contact, deepest)
    return truth_kernels.TruthColumns(
        xi,
        xi_s,
        v_p,
        f_c,
        f_a,
        xi_a,
        f_c1,
        f_a1,
        displaced=modal_displacement(spec, truth),
        dents=np.empty(0) if dents is None else dents,
    )


def modal_displacement(spec: PlantSpec, truth: np.ndarray) -> np.ndarray:
    """Displacement at the struck point without that of the modes left out, a spring between the
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
    the next one or the end of the steps.

    A contact that the run's end cuts off counts with what there is of it, if there is any; one
    within one step with the whole step.
    """
    starts, ends = contacts(truth[F_C])
    size = truth.shape[1]
    if size <= _FEW_STEPS or not starts:
        return []
    columns, by = _columns(spec, truth), _reading(spec)
    work = _step_work_j(columns, by, 0)
    metrics, found = np.empty(METRICS), []
    for i, start in enumerate(starts):
        end = ends[i] if i < len(ends) else -1
        if truth_kernels.contact_metrics(columns, 0, start, end, by, metrics):
            until = starts[i + 1] if i + 1 < len(starts) else size
            found.append(impact_of(metrics, spec.step_s, float(work[start:until].sum())))
    return found


def step_work_j(spec: PlantSpec, truth: np.ndarray, first: int = 0) -> np.ndarray:
    """Work of contact and actuator force on the plate over every step from `first` on, the last
    zero; J, (steps,), with room for those before.

    Where a force changes over a step, F_1 adds F_1 h (v_1 - v_0)/6 by Hermite's mean of the
    displacement; on an infinite plate, where v = F/Z, F_1^2 h/(3 Z). Of an actuator elsewhere, the
    velocity is taken from its places.
    """
    return _step_work_j(_columns(spec, truth), _reading(spec), first)


def _step_work_j(
    columns: truth_kernels.TruthColumns, by: truth_kernels.Reading, first: int
) -> np.ndarray:
    work, speeds = np.empty((2, len(columns.xi)))
    truth_kernels.plate_work(columns, first, by, speeds, work)
    return work


def work_j(spec: PlantSpec, truth: np.ndarray, first: int) -> float:
    """Work of both forces on the plate over steps (COLUMNS, steps) from `first` on, J."""
    return float(step_work_j(spec, truth, first)[first:].sum())
