"""Curves of a run for a replay, thinned while its steps arrive."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hertzloop.plant.time_series import F_A, F_C, V_P, XI
from hertzloop.recordings.replay.contacts import Span
from hertzloop.recordings.replay.decimation import FULL_RATE_SAMPLES, Decimator, Line, within
from hertzloop.results.energy_history import energy_histories
from hertzloop.results.impacts import Block
from hertzloop.scene.setup import Setup

SPECTRUM_STEPS = 1 << 19  # from a run's start
_NEAR = 2000  # steps before and after a contact that are kept
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


def overlay(
    setup: Setup,
    blocks: Iterable[Block],
    names: Iterable[str],
    steps: int,
    spans: list[Span] | None = None,
) -> Overlay:
    """Collect the curves of a run.

    Args:
        setup: the setup of the run.
        blocks: its truth.
        names: the wanted curves: "xi", "F_c", "F_a", "v_p", "sphere", "plate", "contact", "fed".
        steps: number of steps of the run. The curves of a short run are complete.
        spans: steps where the curves of a longer run are complete; by default around the first
            contacts.
    """
    decimators = {name: Decimator(steps) for name in names}
    touched, start_j = None, 0.0
    speed: list[np.ndarray] = []
    left = FULL_RATE_SAMPLES
    for first, truth, energies in energy_histories(setup, blocks):
        touching = np.flatnonzero(truth[XI] < 0.0)
        if touched is None:
            start_j = start_j or float(energies.sphere[0])
            touched = first + int(touching[0]) if len(touching) else None
        if first < SPECTRUM_STEPS:
            speed.append(truth[V_P, : SPECTRUM_STEPS - first].copy())
        if spans is not None:
            near = within(spans, first, truth.shape[1])
        else:
            # A sphere that comes to rest touches for ever: the first contacts are shown in full.
            near = _around(touching, truth.shape[1])
            if left <= 0:
                near[:] = False
            left -= int(np.count_nonzero(near))
        for name, decimator in decimators.items():
            values = truth[_ROWS[name]] if name in _ROWS else getattr(energies, name)
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
