"""Whether the loop of a run is stable, from the work of the actuator."""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.time_series import F_A, XI_A, XI_P
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup

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
