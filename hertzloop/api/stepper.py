"""The plant of a scene, one step at a time, for a loop of one's own."""

import math

import numpy as np

from hertzloop.api.scenes import AnyScene, current
from hertzloop.closed_loop import loop
from hertzloop.closed_loop.exchange import HELD
from hertzloop.closed_loop.parts import elsewhere, empty_unsent, exchange, plant_side
from hertzloop.plant.plant import Balance
from hertzloop.plant.state_kernels import STEP
from hertzloop.scene.build import build_plant, build_sensor
from hertzloop.scene.setup import resolve


class Stepper:
    """Plant, actuator and sensor of a scene, one step at a time.

    The law and the signal path of the scene do not act: the caller says which force the actuator is
    told at each step. Under the forces of a run, the samples have the bits of that run.

    Args:
        scene: the scene, or its name or TOML file.

    Attributes:
        sample: the latest sample of the sensor, in the unit of its quantity.
        steps: number of steps of the scene.
        step_s: length of a step, s.

    Raises:
        SceneError: the scene cannot be simulated.
    """

    def __init__(self, scene: AnyScene) -> None:
        setup = resolve(current(scene))
        self.steps, self.step_s = setup.run.steps, setup.run.step_s
        self._plant = build_plant(setup)
        sensor = build_sensor(setup, setup.run.steps + 1)  # the last step ends with a sample
        self._side, self._unsent = plant_side(self._plant, sensor), empty_unsent(1, 1)
        self._exchange = exchange(HELD, elsewhere(np.zeros(1)))
        self.sample = self._go_on(0.0, 0)

    @property
    def steps_done(self) -> int:
        """Number of steps done."""
        return int(self._plant.state.counts[STEP])

    def step(self, force_n: float) -> float:
        """Run one step under a commanded force of the actuator.

        Args:
            force_n: the force, N, up on the plate.

        Returns:
            The latest sample, at the end of the step or before, if the sensor takes none there.

        Raises:
            ValueError: the force is not finite, or the last step of the scene is done.
        """
        if not math.isfinite(force_n):
            raise ValueError(f"force_n = {force_n}: must be finite.")
        if self.steps_done >= self.steps:
            raise ValueError(f"the {self.steps} steps of the scene are done. Make a new Stepper.")
        self.sample = self._go_on(force_n, 1)
        return self.sample

    def balance(self) -> Balance:
        """Return energy (J) and momentum (N s) until now. Call it once, after the last step."""
        return self._plant.close_balance()

    def _go_on(self, force_n: float, steps: int) -> float:
        self._exchange.commands[0] = force_n
        loop.run(self._side, self._exchange, self._unsent, self.steps_done + steps)
        return float(self._unsent.values[0])
