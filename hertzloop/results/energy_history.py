"""The energies of sphere, plate, contact and actuator over time."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.time_series import F_A, F_C, XI_A, XI_P, XI_S
from hertzloop.results.impacts import Block
from hertzloop.scene.setup import Setup


@dataclass(frozen=True)
class EnergyHistory:
    """Energies at every step of a block, J, each of shape (steps,).

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


def energy_histories(
    setup: Setup, blocks: Iterable[Block]
) -> Iterator[tuple[int, np.ndarray, EnergyHistory]]:
    """Yield the blocks of a run, truth (10, steps), each with its energies.

    Forces are held over a step here. That is accurate enough for a picture; the energy balance of a
    run is exact.
    """
    spec = setup.plant
    mass, place = spec.sphere.mass_kg, XI_P if spec.same_point else XI_A
    fed_j = pushed_j = start_j = 0.0
    last: np.ndarray | None = None
    for first, truth in blocks:
        joined = truth if last is None else np.concatenate([last, truth], axis=1)
        with np.errstate(over="ignore", invalid="ignore"):  # of a loop that explodes
            fed = fed_j + _work(joined[F_A], joined[place])
            pushed = pushed_j + _work(joined[F_C], joined[XI_P])
            speed = np.diff(joined[XI_S]) / setup.run.step_s
            speed = np.concatenate([speed[:1], speed]) if speed.size else np.zeros(1)
            sphere = 0.5 * mass * speed**2 + mass * GRAVITY_M_S2 * joined[XI_S]
            fed_j, pushed_j = float(fed[-1]), float(pushed[-1])
            new = slice(-truth.shape[1], None)
            fed, plate, sphere = fed[new], (fed - pushed)[new], sphere[new]
            if last is None:
                start_j = float(sphere[0])
            contact = start_j + fed - plate - sphere
        last = truth[:, -1:]
        yield first, truth, EnergyHistory(sphere, plate, np.asarray(contact), fed)


def _work(force_n: np.ndarray, place_m: np.ndarray) -> np.ndarray:
    """Return the work of a force, held over each step, until every step; J."""
    return np.concatenate([[0.0], np.cumsum(force_n[:-1] * np.diff(place_m))])
