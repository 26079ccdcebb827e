"""Statistics of a run, from its time series: extremes, demand, force timing and stability."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.plant.metrics.impacts import Impact
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.time_series import F_A, F_A1, F_C, F_C1, V_P, XI_A, XI_P
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup


@dataclass(frozen=True)
class Extremes:
    """Largest values of a run; zero in a run without contact.

    Attributes:
        force_n: largest contact force, also within the steps, N.
        contact_s: duration of the contact with that force, s. If the run ends during that contact,
            it is at least the duration on a rigid plate.
        deflection_m: largest absolute deflection of the contact point, m.
        actuator_n: largest absolute force of the actuator, N.
        touched_s: start of the first contact, s.
    """

    force_n: float
    contact_s: float
    deflection_m: float
    actuator_n: float
    touched_s: float


def extremes_of(spec: PlantSpec, truth: np.ndarray, impacts: Sequence[Impact]) -> Extremes:
    """Return the largest values of a time series, shape (10, steps), with these impacts."""
    force_n, actuator_n = (
        float((np.abs(truth[mean]) + np.abs(truth[slope])).max(initial=0.0))
        for mean, slope in ((F_C, F_C1), (F_A, F_A1))
    )
    if math.isnan(force_n) or math.isnan(actuator_n):  # of a loop that explodes
        force_n = actuator_n = 0.0
    deflection_m = float(np.abs(truth[XI_P]).max(initial=0.0))
    hardest = max(impacts, key=lambda impact: impact.peak_force_n, default=None)
    lasts_s = 0.0 if hardest is None else hardest.duration_s
    touching = truth.shape[1] > 0 and truth[F_C, -1] != 0.0
    if touching and hardest is not None and hardest is impacts[-1]:
        lasts_s = max(lasts_s, rigid_impact(spec.sphere, spec.contact).contact_s)
    touched_s = impacts[0].start_s if impacts else 0.0
    return Extremes(force_n, lasts_s, deflection_m, actuator_n, touched_s)


@dataclass(frozen=True)
class ActuatorDemand:
    """What a run demands of its actuator.

    Attributes:
        force_n: largest absolute force, N.
        slew_n_s: largest rate of change of the force, N/s; from step to step for a held force.
        power_w: largest absolute power, W.
        delay_s: delay of a slow command by the actuator's bandwidth, s.
    """

    force_n: float
    slew_n_s: float
    power_w: float
    delay_s: float


def demand_of(spec: PlantSpec, truth: np.ndarray) -> ActuatorDemand | None:
    """Return the demand of a time series, shape (10, steps); None if the actuator never acts.

    The time series holds the velocity at the contact point. For an actuator elsewhere, the velocity
    is the mean over a step.
    """
    force, slope, v = truth[F_A], np.abs(truth[F_A1]), truth[V_P]
    most_n = float((np.abs(force) + slope).max(initial=0.0))
    if most_n == 0.0:
        return None
    with np.errstate(over="ignore", invalid="ignore"):  # of a loop that explodes
        moved = np.diff(truth[XI_A]) / spec.step_s
        speed = 0.5 * (v[1:] + v[:-1]) if spec.same_point else moved
        power_w = float(np.abs(force[:-1] * speed).max(initial=0.0))
        change_n = float(np.abs(np.diff(force, prepend=0.0)).max())
    slew_n_s = max(change_n, 2.0 * float(slope.max())) / spec.step_s
    return ActuatorDemand(most_n, slew_n_s, power_w, spec.actuator.delay_s)


@dataclass(frozen=True)
class ForceTiming:
    """When the actuator acts, relative to the contacts.

    Attributes:
        after_touch_s: time from the first contact to the first force, s; negative if the force
            comes first, nan without a contact.
        apart: share of the absolute impulse that acts without contact.
    """

    after_touch_s: float
    apart: float


def force_timing(spec: PlantSpec, truth: np.ndarray) -> ForceTiming | None:
    """Return the timing in a time series, shape (10, steps); None if the actuator never acts."""
    touching, pushed = truth[F_C] != 0.0, np.abs(truth[F_A])
    if not pushed.any():
        return None
    steps = np.argmax(pushed > 0.0) - np.argmax(touching) if touching.any() else math.nan
    share = _sum(pushed[~touching]) / _sum(pushed)
    return ForceTiming(float(steps) * spec.step_s, share)


def _sum(values: np.ndarray) -> float:
    """Add values one after the other, which has the same bits on every computer."""
    return float(np.add.accumulate(np.append(0.0, values))[-1])


# Plate, contact and gravity hold no more energy than the sphere brought, and what is fed in. A law
# that copies or opposes what it senses exchanges about that energy at most (0.9 times in all
# shipped scenes, 4.2 times with every kappa up to 2); where it goes on feeding in what it has fed
# in itself, no multiple is the last. Runs of 20 000 to 60 000 steps that leave the bound are beyond
# a thousandfold. A loop that has put in more than the sphere brought pumps, bounded or not: plate
# and sphere then hold energy that no impact could have given them.
UNSTABLE = 10.0  # times the energy of the impact


@dataclass(frozen=True)
class Stability:
    """Stability of a loop. A law without feedback is never unstable and never pumps.

    Attributes:
        unstable: whether the actuator exchanged more than UNSTABLE times the energy of the impact.
        pumps: whether the actuator added, in sum, more than the energy of the impact.
        since_s: time from which on the exchanged energy exceeded that of the impact, s; None if the
            loop is stable and does not pump, or if the excess is gone at the end.
        most_injected: largest exchanged energy, in units of the energy of the impact.
        fed_in: largest added energy in sum, in the same unit.
        largest_force_n: largest force of the actuator, N.
        of_contact: that force over the largest contact force of the impact on a rigid plate.
    """

    unstable: bool
    pumps: bool
    since_s: float | None
    most_injected: float
    fed_in: float
    largest_force_n: float
    of_contact: float


def stability_of(setup: Setup, truth: np.ndarray) -> Stability:
    """Return the stability of the loop of a run, from its time series, shape (10, steps)."""
    spec = setup.plant
    try:  # without feedback a law may feed in any energy
        closed = not loaded_law(setup).open_loop
    except SceneError:  # the law of a recording may not be there any more
        closed = True
    impact_j = spec.sphere.mass_kg * GRAVITY_M_S2 * spec.sphere.drop_height_m
    force, place = truth[F_A], truth[XI_P if spec.same_point else XI_A]
    with np.errstate(over="ignore", invalid="ignore"):  # of a loop that explodes
        injected = np.add.accumulate(force[:-1] * np.diff(place))
    most_j = fed_j = math.inf
    if np.isfinite(injected).all():
        most_j = float(np.abs(injected).max(initial=0.0))
        fed_j = float(injected.max(initial=0.0))
    within = np.flatnonzero(np.abs(injected) <= impact_j)
    since = int(within[-1]) + 1 if len(within) else 0
    exceeds = since < len(injected)
    largest_n = 0.0 if np.isnan(force).any() else float(np.abs(force).max(initial=0.0))
    unstable = closed and not most_j <= UNSTABLE * impact_j
    pumps = closed and not fed_j <= impact_j
    return Stability(
        unstable=unstable,
        pumps=pumps,
        since_s=since * setup.run.step_s if exceeds and (unstable or pumps) else None,
        most_injected=most_j / impact_j,
        fed_in=fed_j / impact_j,
        largest_force_n=largest_n,
        of_contact=largest_n / rigid_impact(spec.sphere, spec.contact).peak_n,
    )
