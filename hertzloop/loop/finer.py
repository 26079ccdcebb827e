"""A scene's closed loop on a finer plant: sensor, law and line keep their own step."""

import numpy as np

from controller import law_kernels as laws
from controller.door.bound import LawFault
from hertzloop.loop.watchdog import watching
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.quantities import SENSED
from hertzloop.setup import Setup
from plant.plant import Plant
from plant.time_series import series_under
from sensors import kernels as sk


def finer_loop(setup: Setup, plant: Plant, steps: int, parts_of_step: int) -> np.ndarray:
    """Rows of truth, shape (10, steps * parts_of_step), of the first `steps` steps of a scene on a
    plant at its start that takes `parts_of_step` steps in each of them.

    Samples, forces and what is drawn by chance belong to the steps of the scene; a force is held
    over one. Raises SceneError when the law fails.
    """
    sensor = setup.start_sensor()
    controller = setup.start_controller()
    at, means = sensor.spec.of_state, SENSED[setup.quantity].over_step
    seen = np.full(parts_of_step, float(plant.state.body[at]))
    rows = []
    with watching(setup, lambda: int(controller.law_state.counts[laws.SAMPLES])):
        for step in range(steps):
            sk.follow(sensor.model, sensor.state, float(seen.mean() if means else seen[-1]))
            if step % sensor.spec.every_steps == 0:
                index = step // sensor.spec.every_steps
                value = sk.sample(sensor.model, sensor.state, index)[1]
                try:
                    controller.process(np.array([value]), look_ahead=False)
                except LawFault as error:
                    raise SceneError(str(error)) from error
            force = controller.forces[step : step + 1]
            for i in range(parts_of_step):
                rows.append(series_under(plant, force))
                seen[i] = float(plant.state.body[at])
    return np.concatenate(rows, axis=1)
