"""Plant, sensor and controller of a run, joined in one compiled call."""

from dataclasses import dataclass

import numpy as np

from hertzloop.controller.controller import Controller
from hertzloop.loop import kernels as loop_kernels
from hertzloop.plant.metrics.impact_kernels import NEVER, ImpactFollower
from hertzloop.plant.plant import Plant
from hertzloop.sensors.acquisition import Sensor


@dataclass(frozen=True)
class ClosedLoop:
    """The parts of a run, with room for what they produce.

    Attributes:
        plant: Plant, at its present step.
        sensor: Sensor.
        controller: Law and signal path. Call its `check` after `advance`.
        window: Receives time series and samples.
        modes: Receives the mode of the law after each sample.
        delays: Receives the latched delay of the law after each sample, in samples.
    """

    plant: Plant
    sensor: Sensor
    controller: Controller
    window: loop_kernels.Window
    modes: np.ndarray
    delays: np.ndarray

    def advance(self, end: int, impact: ImpactFollower = NEVER) -> bool:
        """Run up to step `end`; return whether the followed impact was over before."""
        controller = self.controller
        over = loop_kernels.closed_loop(
            self.plant.model,
            self.plant.state,
            self.sensor.model,
            self.sensor.state,
            controller.law,
            controller.law_state,
            controller.line,
            controller.line_state,
            controller.forces,
            self.window,
            self.modes,
            self.delays,
            end,
            impact,
        )
        return bool(over)
