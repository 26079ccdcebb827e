"""The energies of sphere, plate, contact and actuator over time."""

from dataclasses import dataclass

import numpy as np

from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.time_series import F_A, F_C, XI_A, XI_P, XI_S
from hertzloop.scene.setup import Setup


@dataclass(frozen=True)
class EnergyHistory:
    """Energies at every step, J, each of shape (steps,).

    At every step, sphere + plate + contact is the energy at the start + fed.

    Attributes:
        sphere: kinetic energy, and that of the height above the plate at rest.
        plate: work of contact force and actuator force on the plate, dissipated energy included.
        contact: energy that the contact stores and has dissipated.
        fed: work of the actuator.
    """

    sphere: np.ndarray
    plate: np.ndarray
    contact: np.ndarray
    fed: np.ndarray


def energy_history(setup: Setup, truth: np.ndarray) -> EnergyHistory:
    """Return the energies of a run from its time series, shape (10, steps).

    Forces are held over a step here. That is accurate enough for a picture; the energy balance of a
    run is exact.
    """
    spec = setup.plant
    mass, place = spec.sphere.mass_kg, XI_P if spec.same_point else XI_A
    with np.errstate(over="ignore", invalid="ignore"):  # of a loop that explodes
        fed = _work(truth[F_A], truth[place])
        plate = fed - _work(truth[F_C], truth[XI_P])
        speed = np.diff(truth[XI_S], prepend=np.nan) / setup.run.step_s
        speed[:1] = speed[1] if speed.size > 1 else 0.0
        sphere = 0.5 * mass * speed**2 + mass * GRAVITY_M_S2 * truth[XI_S]
        return EnergyHistory(sphere, plate, sphere[:1] + fed - plate - sphere, fed)


def _work(force_n: np.ndarray, place_m: np.ndarray) -> np.ndarray:
    """Return the work of a force, held over each step, until every step; J."""
    return np.concatenate([[0.0], np.cumsum(force_n[:-1] * np.diff(place_m))])[: len(force_n)]
