"""Curves of a run for a replay, decimated away from contacts."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.time_series import F_A, F_C, V_P, XI, XI_A, XI_P, XI_S
from hertzloop.recordings.replay.contacts import contact_spans
from hertzloop.recordings.replay.decimation import Line, decimated
from hertzloop.scene.setup import Setup

SPECTRUM_STEPS = 1 << 19  # from a run's start
_ROWS = {"xi": XI, "F_c": F_C, "F_a": F_A, "v_p": V_P}


@dataclass
class Overlay:
    """Curves of a run.

    Attributes:
        lines: signals (m, N, m/s) and energies (J) by name.
        touched: step of the first contact; None without one.
        speed_m_s: plate velocity from the start on, for a spectrum.
        start_j: energy of the sphere at the start, J.
    """

    lines: dict[str, Line]
    touched: int | None
    speed_m_s: np.ndarray
    start_j: float


def overlay(setup: Setup, truth: np.ndarray, names: Iterable[str]) -> Overlay:
    """Return the curves of a run.

    Args:
        setup: the setup of the run.
        truth: its time series, shape (10, steps).
        names: the wanted curves: "xi", "F_c", "F_a", "v_p", "sphere", "plate", "contact", "fed".
    """
    contacts, energies = contact_spans(truth[F_C]), energy_history(setup, truth)
    lines = {
        name: decimated(truth[_ROWS[name]] if name in _ROWS else getattr(energies, name), contacts)
        for name in names
    }
    touched = contacts[0][0] if contacts else None
    start_j = float(np.sum(energies.sphere[:1]))
    return Overlay(lines, touched, truth[V_P, :SPECTRUM_STEPS].copy(), start_j)


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
