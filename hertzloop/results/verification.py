"""How much a finer model changes in the first impact of a run."""

import math
from dataclasses import dataclass, replace

import numpy as np

from hertzloop.loop.simulate import simulate
from hertzloop.plant import state_kernels
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.plant.plant import MOST_MODES, Plant, PlantSpec
from hertzloop.plant.schemes.factory import built
from hertzloop.plant.schemes.registry import SCHEMES, schemes_where
from hertzloop.plant.state_kernels import FLIGHT_V, FLIGHT_X, XI_S
from hertzloop.plant.time_series import F_A, F_C, XI
from hertzloop.results.impacts import first_impact
from hertzloop.scene.build import build_plant
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup

_START = [FLIGHT_X, FLIGHT_V, state_kernels.XI, XI_S]

_SMALL = 0.01  # of a push, from which on it stores 1e-4 of what it did


@dataclass(frozen=True)
class Verification:
    """What a finer model changes in the first impact.

    Attributes:
        penetration: change of the gap, relative to its largest value in contact.
        rebound_speed: change of the rebound speed, relative to the impact speed.
        plate_energy: relative change of the plate energy.
        step_ns: step of the finer model, ns.
        frequency_limit_hz: limit of its modes, Hz.
    """

    penetration: float
    rebound_speed: float
    plate_energy: float
    step_ns: float
    frequency_limit_hz: float

    @property
    def largest(self) -> float:
        """Largest of the three relative changes."""
        return max(self.penetration, self.rebound_speed, self.plate_energy)


def verify(setup: Setup, truth: np.ndarray) -> Verification | None:
    """Repeat the first impact of a run, known by its truth, with the loop closed: the law
    answers the finer plant, from samples of the scene's own step.

    None without an impact that ends within the run. Raises SceneError for the published scheme.
    """
    check_verifiable(setup)
    return against(setup, truth, finer_spec(setup))


def check_verifiable(setup: Setup) -> None:
    """Raise SceneError where the finer plant cannot be computed."""
    if not SCHEMES[setup.run.scheme].converges:
        raise SceneError(
            f"run.scheme = '{setup.run.scheme}' does not converge and cannot be verified. "
            f"Use {schemes_where(lambda row: row.converges)}."
        )
    fine = finer_spec(setup)
    modes = fine.plate.modes_below(fine.frequency_limit_hz)
    if modes > MOST_MODES:
        local = fine.plate.local_plate
        raise SceneError(
            f"--verify needs about {modes:.2g} modes of the plate up to "
            f"{fine.frequency_limit_hz:.3g} Hz; the limit is {MOST_MODES}. Remove --verify, or "
            f"use a smaller or thicker plate than plate.size_m = "
            f"{list(setup.scene.plate.size_m or ())} with plate.thickness_m = "
            f"{local.thickness_m if local else math.nan:g}"
        )


def finer_spec(setup: Setup) -> PlantSpec:
    """A scene's plant with half the step and twice the modes, as far as they are known."""
    spec = setup.plant
    limit_hz = spec.frequency_limit_hz
    if spec.plate.mode_table is None:  # a file has the modes that it has
        limit_hz = min(2.0 * limit_hz, spec.plate.highest_hz)
    return replace(
        spec,
        step_s=spec.step_s / 2,
        frequency_limit_hz=limit_hz,
        residual_flexibility=SCHEMES[setup.run.scheme].accepts("plate.tail", "spring"),
        infinite_plate=False,
    )


def against(setup: Setup, truth: np.ndarray, fine: PlantSpec) -> Verification | None:
    """What a finer plant changes in the first impact of a run; None as for `verify`."""
    until = past_first_impact(setup, truth)
    if until is None:
        return None
    times = round(setup.run.step_s / fine.step_s)
    finer_truth = simulate(
        setup, own_plant=started_as(setup, fine), steps=until, parts_of_step=times
    ).truth
    return changes(setup, truth[:, :until], finer_truth, fine)


def past_first_impact(setup: Setup, truth: np.ndarray) -> int | None:
    """Steps until the first contact is over and by one more, so that it is seen to end, and until
    the push is, for as long again at most: what a spring for the modes left out stores under a
    force counts once it has come back. None if the contact does not end within the steps."""
    found = first_impact(setup, truth)
    if not found or not found.ended:
        return None
    first, end = found.start, min(found.end + 2, truth.shape[1])
    after = truth[:, end : 2 * end - first]
    pushed = np.abs(truth[F_A])
    small = _SMALL * pushed[first:end].max()
    over = np.flatnonzero((pushed[end : 2 * end - first] <= small) | (after[F_C] != 0.0))
    return end + (int(over[0]) if len(over) else after.shape[1])


def started_as(setup: Setup, fine: PlantSpec) -> Plant:
    """A finer plant at the start of a scene's run."""
    plant = built(fine, setup.run.scheme).at_start(setup.run.phase)
    coarse = build_plant(setup, setup.plant)
    plant.state.body[_START] = coarse.state.body[_START]
    return plant


def changes(
    setup: Setup, truth: np.ndarray, finer_truth: np.ndarray, fine: PlantSpec
) -> Verification | None:
    """What differs in the first impact between a scene's steps and those of a finer plant over the
    same time; None if that has no impact."""
    times = finer_truth.shape[1] // truth.shape[1]
    coarse_impact = impacts_in(setup.plant, truth)[0]
    # Work counts from row to row: without the last part of a step both end at the same time.
    by_finer = impacts_in(fine, finer_truth[:, : finer_truth.shape[1] + 1 - times])
    if not by_finer:
        return None
    contact = math.ceil((coarse_impact.start_s + coarse_impact.duration_s) / setup.run.step_s) + 2
    gap, finer = truth[XI, :contact], finer_truth[XI, ::times][:contact]
    energy = by_finer[0].plate_energy_j
    change = by_finer[0].rebound_speed_m_s - coarse_impact.rebound_speed_m_s
    return Verification(
        penetration=float(np.abs(gap - finer).max() / -finer.min()),
        rebound_speed=abs(change) / coarse_impact.impact_speed_m_s,
        plate_energy=abs(coarse_impact.plate_energy_j - energy) / abs(energy),
        step_ns=1e9 * fine.step_s,
        frequency_limit_hz=fine.frequency_limit_hz,
    )
