"""What the model of the plate that a run chose saves against the full one."""

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np

from hertzloop.setup import Setup
from plant import state_kernels as pk
from plant.plant import Plant, PlantSpec
from plant.schemes.factory import built
from plant.schemes.infinite import impedance_n_s_m
from plant.schemes.registry import SCHEMES
from plant.structures.structure import frequencies
from plant.time_series import series_under

_COUNTED = 500_000  # modes; beyond, the full model is only said to be larger
_TIMED = 4_000  # frequencies that can be built and timed within 0.3 s
_LIFT_M = 1e3  # keeps the sphere off the plate
_ROUNDS, _STEPS = 5, 1_000  # of the timing, both models in turn


def chosen_model(setup: Setup) -> dict[str, Any] | None:
    """The plate's model of a run, and what the full one, all modes up to pi/dt, would have cost.

    `plate_model`: "modal" or "infinite", with `impedance_n_s_m` of the infinite plate and
    `infinite_until_s`, the time of the run until which it does (None where it does not for
    a whole contact). `full`: its `frequency_limit_hz`, its `frequencies` (None if there are
    too many to count; `modes` are about how many modes), and the `frequency_ratio` to those
    chosen (None for an infinite plate); `measured_ratio`: of the time for a step under force,
    measured now, None where that would take long. None for the published scheme, which always
    has the full model.
    """
    if not SCHEMES[setup.scheme].limits_modes:
        return None
    spec = setup.plant
    lasts_s, local = setup.infinite_plate_lasts_s, spec.plate.local_plate
    return {
        "plate_model": "infinite" if spec.infinite_plate else "modal",
        "impedance_n_s_m": impedance_n_s_m(local) if local else None,
        "infinite_until_s": setup.first_touch_s + lasts_s if lasts_s else None,
        "full": _full_model(setup, spec),
    }


def _full_model(setup: Setup, spec: PlantSpec) -> dict[str, Any]:
    limit_hz = 0.5 / setup.step_s
    if spec.plate.mode_table is None:
        limit_hz = min(limit_hz, spec.plate.highest_hz)
    modes = spec.plate.modes_below(limit_hz)
    full: dict[str, Any] = {
        "frequency_limit_hz": limit_hz, "modes": modes,
        "frequencies": None, "frequency_ratio": None, "measured_ratio": None,
    }  # fmt: skip
    if modes > _COUNTED:
        return full

    def count(up_to_hz: float) -> int:
        omega = 2.0 * math.pi * up_to_hz
        return frequencies(spec.plate, spec.contact_point_m, spec.actuator_point_m, omega)

    full["frequencies"] = count(limit_hz)
    if not spec.infinite_plate:
        full["frequency_ratio"] = full["frequencies"] / count(spec.frequency_limit_hz)
    if full["frequencies"] <= _TIMED:
        whole = replace(spec, frequency_limit_hz=limit_hz, infinite_plate=False)
        chosen = built(spec, setup.scheme)
        full["measured_ratio"] = _ratio(built(whole, setup.scheme), chosen)
    return full


def _ratio(full: Plant, chosen: Plant) -> float:
    """Time of a step under an actuator force, the one's against the other's: least of some rounds
    in which they take turns. (In flight a damped plate's modes fall silent and cost nothing.)"""
    plants = [full.at_start(), chosen.at_start()]
    for plant in plants:
        plant.state.body[[pk.FLIGHT_X, pk.XI, pk.XI_S]] += _LIFT_M
    least = [math.inf, math.inf]
    force = np.ones(_STEPS)
    for _ in range(_ROUNDS):
        for i, plant in enumerate(plants):
            started = time.perf_counter()
            series_under(plant, force)
            least[i] = min(least[i], time.perf_counter() - started)
    return least[0] / least[1]
