"""Time of a step in one checkout: a process that measures the cases that it reads, line by line.

It is run by its path with the code of any checkout, so it imports hertzloop alone.
"""

import json
import sys
import time
from functools import cache

import numpy as np

from hertzloop.loop.simulate import simulate
from hertzloop.plant.plant import Plant

try:
    from hertzloop.closed_loop.parts import series_under
except ImportError:  # another checkout
    from hertzloop.plant.time_series import (  # type: ignore[attr-defined,no-redef]
        series_under,
    )
from hertzloop.scene.build import build_plant
from hertzloop.scene.setup import Setup, load

_MOST_STEPS = 60_000


def _steps(setup: Setup) -> int:
    # Another checkout may have no table of the run.
    run = vars(setup).get("run", setup)
    return int(run.steps)


@cache
def case_of(scene: str, yields: bool, points: int) -> tuple[Setup, Plant]:
    """A scene file whose actuator is at the contact; or (3 points) 15 mm beside it, with a
    sensor of the plate's velocity 30 mm beside it. `yields`: so does the contact."""
    x, y = load(scene).plant.contact_point_m
    keys = [f"plate.actuator_point_m=[{x},{y}]"]
    if points == 3:
        keys = [f"plate.actuator_point_m=[{x + 0.015},{y}]", f"sensors.point_m=[{x},{y + 0.03}]"]
        keys += ["sensors.quantity=v_p", "controller.law=velocity_feedback", "controller.kappa=0.1"]
    if yields:
        keys += ["contact.plasticity=thornton", "contact.limiting_pressure_pa=1e9"]
    setup = load(scene, keys)
    setup = setup.with_steps(min(_steps(setup), _MOST_STEPS))
    return setup, build_plant(setup)


def step_us(scene: str, yields: bool, points: int, force_n: float | None) -> float:
    """Processor time of a step, us: of the plant alone under a force, or of the whole loop."""
    setup, plant = case_of(scene, yields, points)
    plant = plant.at_start()
    if force_n is None:
        started = time.thread_time()
        simulate(setup, own_plant=plant)
        return 1e6 * (time.thread_time() - started) / _steps(setup)
    forces = np.full(_steps(setup), force_n)
    started = time.thread_time()
    series_under(plant, forces)
    return 1e6 * (time.thread_time() - started) / _steps(setup)


if __name__ == "__main__":
    for line in sys.stdin:
        print(json.dumps(step_us(*json.loads(line))), flush=True)
