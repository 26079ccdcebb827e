"""Curves of a run for a replay, thinned as its rows come, and who holds the energy of an impact."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from hertzloop.analysis.impacts import Block
from hertzloop.plant.time_series import F_A, F_C, V_P, XI, XI_A, XI_P, XI_S
from hertzloop.recordings.replay.contacts import Span
from hertzloop.recordings.replay.decimation import FULL_RATE_SAMPLES, Decimator, Line, within
from hertzloop.setup import Setup


@dataclass(frozen=True)
class Ledger:
    """Energies at every step of a block, J, each (steps,).

    `sphere`: kinetic, and of height above the plate at rest; `plate`: the work of contact and
    actuator on it, with what it has dissipated of that; `contact`: what the contact stores and has
    dissipated; `fed`: the work of the actuator. sphere + plate + contact = that at the start + fed.
    That of a hammer which a hand withdraws is the one with which it left the plate.
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
    touched, left_j = False, None
    for first, rows in blocks:
        joined = rows if last is None else np.concatenate([last, rows], axis=1)
        with np.errstate(over="ignore", invalid="ignore"):  # of a loop that explodes
            fed = fed_j + _work(joined[F_A], joined[place])
            pushed = pushed_j + _work(joined[F_C], joined[XI_P])
            speed = np.diff(joined[XI_S]) / setup.step_s
            speed = np.concatenate([speed[:1], speed]) if speed.size else np.zeros(1)
            sphere = 0.5 * mass * speed**2 + mass * spec.sphere.gravity_m_s2 * joined[XI_S]
            fed_j, pushed_j = float(fed[-1]), float(pushed[-1])
            new = slice(-rows.shape[1], None)
            fed, plate, sphere = fed[new], (fed - pushed)[new], sphere[new]
            if spec.sphere.hand is not None:
                apart = rows[XI] >= 0.0
                began = np.logical_or.accumulate(~apart) | touched
                touched, left = bool(began[-1]), began & apart
                if left_j is None and np.any(left):
                    left_j = float(sphere[np.argmax(left)])
                sphere = np.where(left, left_j, sphere) if left_j is not None else sphere
            if last is None:
                start_j = float(sphere[0])
            contact = start_j + fed - plate - sphere
        last = rows[:, -1:]
        yield first, rows, Ledger(sphere, plate, np.asarray(contact), fed)


def _work(force_n: np.ndarray, place_m: np.ndarray) -> np.ndarray:
    """Work of a force, held over each step, until every step; J."""
    return np.concatenate([[0.0], np.cumsum(force_n[:-1] * np.diff(place_m))])


SPECTRUM_STEPS = 1 << 19  # from a run's start
_NEAR = 2000  # steps before and after a contact that are kept
_ROWS = {"xi": XI, "F_c": F_C, "F_a": F_A, "v_p": V_P}


@dataclass
class Overlay:
    """Signals (m, N, m/s) and energies (J) by name; the step of the first contact, None without
    one; plate velocity from the start on, for a spectrum."""

    lines: dict[str, Line]
    touched: int | None
    speed_m_s: np.ndarray
    start_j: float


def overlay(
    setup: Setup,
    blocks: Iterable[Block],
    names: Iterable[str],
    steps: int,
    spans: list[Span] | None = None,
) -> Overlay:
    """Those of "xi", "F_c", "F_a", "v_p", "sphere", "plate", "contact", "fed" that are asked for,
    of a run of so many steps; short ones in full, others where `spans` of steps say, next to the
    first contacts if these are not given."""
    decimators = {name: Decimator(steps) for name in names}
    touched, start_j = None, 0.0
    speed: list[np.ndarray] = []
    left = FULL_RATE_SAMPLES
    for first, rows, energies in ledgers(setup, blocks):
        touching = np.flatnonzero(rows[XI] < 0.0)
        if touched is None:
            start_j = start_j or float(energies.sphere[0])
            touched = first + int(touching[0]) if len(touching) else None
        if first < SPECTRUM_STEPS:
            speed.append(rows[V_P, : SPECTRUM_STEPS - first].copy())
        if spans is not None:
            near = within(spans, first, rows.shape[1])
        else:
            # A sphere that comes to rest touches for ever: the first contacts are shown in full.
            near = _around(touching, rows.shape[1])
            if left <= 0:
                near[:] = False
            left -= int(np.count_nonzero(near))
        for name, decimator in decimators.items():
            values = rows[_ROWS[name]] if name in _ROWS else getattr(energies, name)
            decimator.feed(first, values, near)
    lines = {name: decimator.line() for name, decimator in decimators.items()}
    return Overlay(lines, touched, np.concatenate(speed) if speed else np.empty(0), start_j)


def _around(touching: np.ndarray, count: int) -> np.ndarray:
    """Whether each of `count` steps of a block is next to a contact."""
    if not len(touching):
        return np.zeros(count, bool)
    change = np.zeros(count + 1, np.int64)
    np.add.at(change, np.maximum(touching - _NEAR, 0), 1)
    np.add.at(change, np.minimum(touching + _NEAR + 1, count), -1)
    return np.cumsum(change)[:count] > 0
