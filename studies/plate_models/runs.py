"""First impacts of scenes on plates with other limits, tails and theories, and what steps cost."""

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hertzloop.analysis.impacts import consistent_impacts
from hertzloop.loop.compiled import simulate
from hertzloop.setup import Setup, load
from plant.figures.impacts import Impact
from plant.plant import Plant
from plant.schemes import state_kernels as pk
from plant.schemes.collocation import CollocationPlant
from plant.time_series import series_under

_ROUNDS, _STEPS = 201, 400  # of the timing; the plants take turns


@dataclass(frozen=True)
class Run:
    """First impact of a run, what its tail took (J), the largest residual of its books, and the
    number of frequencies."""

    impact: Impact
    tail_j: float
    residual: float
    frequencies: int


def run(setup: Setup, **changes: Any) -> Run:
    """A scene in its closed loop, its plant's description changed."""
    spec = replace(setup.plant, **changes)
    plant = CollocationPlant(spec)
    done = simulate(setup, own_plant=plant)
    books = done.books
    residual = max(abs(books.energy_residual), abs(books.momentum_residual))
    found = consistent_impacts(setup, done.rows, spec)[0]
    return Run(found, books.tail_dissipated_j, residual, len(plant.modes.omega))


def changes(run: Impact, best: Impact) -> tuple[float, float, float, float]:
    """Of plate energy, rebound over impact speed, peak force and contact time, relative."""
    return (
        run.plate_energy_j / best.plate_energy_j - 1.0,
        (run.rebound_speed_m_s - best.rebound_speed_m_s) / best.impact_speed_m_s,
        run.peak_force_n / best.peak_force_n - 1.0,
        run.duration_s / best.duration_s - 1.0,
    )


def cost_ratios(base: Plant, other: Plant) -> tuple[float, float]:
    """us of a step of `base` in contact, and how many times as long one of `other` takes: of the
    quickest tenth of rounds of both in turn, each from the touch on."""
    started = []
    for plant in (base, other):
        while plant.state.body[pk.F_C] == 0.0:
            series_under(plant, np.zeros(1))
        started.append([array.copy() for array in plant.state])
    times = np.empty((2, _ROUNDS))
    for i in range(_ROUNDS + 1):
        for j, plant in enumerate((base, other)):
            for array, kept in zip(plant.state, started[j], strict=True):
                array[:] = kept
            before = time.perf_counter()
            series_under(plant, np.zeros(_STEPS))
            if i:  # the first round warms up
                times[j, i - 1] = (time.perf_counter() - before) / _STEPS
    quick = np.quantile(times, 0.1, axis=1)
    return 1e6 * float(quick[0]), float(quick[1] / quick[0])


def first_contact(name: str, settings: list[str]) -> Setup:
    """A scene cut to what its first contact needs, the plate by its modes."""
    return load(name, ["run.lead_in_s=2.5e-6", "run.plate_model=modal", *settings])


def shown(value: float) -> str:
    """A change as it is printed."""
    return "" if math.isnan(value) else f"{value:+.1e}"
