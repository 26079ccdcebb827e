"""Who holds the energy of an impact, over time, from rows of truth that come in blocks."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from hertzloop.results.impact_rows import F_A, F_C, XI_A, XI_P, XI_S, Block
from hertzloop.setup import Setup
from plant.contact.hertz import GRAVITY_M_S2


@dataclass(frozen=True)
class Ledger:
    """Energies at every step of a block, J, each (steps,).

    `sphere`: kinetic, and of height above the plate at rest; `plate`: the work of contact and
    actuator on it, with what it has dissipated of that; `contact`: what the contact stores and has
    dissipated; `fed`: the work of the actuator. sphere + plate + contact = that at the start + fed.
    """

    sphere: np.ndarray
    plate: np.ndarray
    contact: np.ndarray
    fed: np.ndarray


def ledgers(setup: Setup, blocks: Iterable[Block]) -> Iterator[tuple[int, np.ndarray, Ledger]]:
    """Blocks of a run, rows of truth (10, steps), each with its ledger. Forces are held over a step
    here: good for a picture; the books of a run are exact."""
    spec = setup.plant
    mass, place = spec.sphere.mass_kg, XI_P if spec.same_point else XI_A
    fed_j = pushed_j = start_j = 0.0
    last: np.ndarray | None = None
    for first, rows in blocks:
        joined = rows if last is None else np.concatenate([last, rows], axis=1)
        with np.errstate(over="ignore", invalid="ignore"):  # of a loop that explodes
            fed = fed_j + _work(joined[F_A], joined[place])
            pushed = pushed_j + _work(joined[F_C], joined[XI_P])
            speed = np.diff(joined[XI_S]) / setup.step_s
            speed = np.concatenate([speed[:1], speed]) if speed.size else np.zeros(1)
            sphere = 0.5 * mass * speed**2 + mass * GRAVITY_M_S2 * joined[XI_S]
            fed_j, pushed_j = float(fed[-1]), float(pushed[-1])
            new = slice(-rows.shape[1], None)
            fed, plate, sphere = fed[new], (fed - pushed)[new], sphere[new]
            if last is None:
                start_j = float(sphere[0])
            contact = start_j + fed - plate - sphere
        last = rows[:, -1:]
        yield first, rows, Ledger(sphere, plate, np.asarray(contact), fed)


def _work(force_n: np.ndarray, place_m: np.ndarray) -> np.ndarray:
    """Work of a force, held over each step, until every step; J."""
    return np.concatenate([[0.0], np.cumsum(force_n[:-1] * np.diff(place_m))])
