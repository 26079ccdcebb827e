"""Curves of a run for a replay, decimated away from contacts."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hertzloop.plant.time_series import F_A, F_C, V_P, XI
from hertzloop.recordings.replay.contacts import contact_spans
from hertzloop.recordings.replay.decimation import Line, decimated
from hertzloop.results.energy_history import energy_history
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
    contacts, energies = contact_spans(truth[XI]), energy_history(setup, truth)
    lines = {
        name: decimated(truth[_ROWS[name]] if name in _ROWS else getattr(energies, name), contacts)
        for name in names
    }
    touched = contacts[0][0] if contacts else None
    start_j = float(np.sum(energies.sphere[:1]))
    return Overlay(lines, touched, truth[V_P, :SPECTRUM_STEPS].copy(), start_j)
