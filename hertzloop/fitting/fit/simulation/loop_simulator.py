"""Simulate the impact of a scene under its law, on frozen modes of the plate.

Sensor, law and line keep the steps of the scene. The plant takes several steps in each of them, so
that a record is as exact as that of a drop without control. Where in a sampling period the sphere
touches the plate is not known of a record; it is the `phase`, in steps of the scene.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hertzloop.fitting.fit.simulation.impact_simulator import ImpactSimulator
from hertzloop.fitting.fit.simulation.simulated_impact import SimulatedImpact
from hertzloop.loop.simulate import finer_loop
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.time_series import F_A
from hertzloop.scene.setup import Setup, resolve

PLANT_NS = 250  # longest step of the plant
_LEAD_SAMPLES = 8  # before the touch; more for the window and the horizon of the law
_HORIZONS = 3
_ROOM_S = 0.01  # added to the run, so that a latency of the search is not longer than it
_ACTS = 1e-12  # N
_KEY_STEP = 2e-3  # of a derivative by the logarithm of a key
_KEY_STEP_ROUNDED = 3e-2  # the same where a converter of the loop rounds


class LoopSimulator(ImpactSimulator):
    """Simulates the impact of one scene under its law, with other values of its keys.

    Args:
        setup: the starting point, with its law.
        duration_s: the longest time after the touch that will be asked for, s.
        accuracy: relative error that leaving out modes may cause.
        plant_ns: longest step of the plant.
    """

    looped = True

    def __init__(
        self, setup: Setup, duration_s: float, accuracy: float, plant_ns: int = PLANT_NS
    ) -> None:
        self.parts = math.ceil(setup.run.step_ns / plant_ns)
        # The plant alone: times of the loop need not be whole steps of the plant.
        alone = setup.plant_only().scene
        ideal = alone.actuator.replaced(dead_time_us=None)
        super().__init__(
            resolve(alone.replaced(actuator=ideal)),
            duration_s,
            accuracy,
            step_ns=max(1, round(setup.run.step_ns / self.parts)),
        )
        self.loop_step_s = setup.run.step_s
        self.spec = replace(self.spec, step_s=setup.run.step_s / self.parts)
        kept = {
            f"run.{key}": getattr(self.setup.scene.run, key)
            for key in ("scheme", "plate_model", "accuracy")
        }
        changed = {
            "sensors.noise_rms": 0.0,
            "run.touch_phase": 0.5,
            "run.duration_s": max(setup.run.duration_s, 2.0 * duration_s) + _ROOM_S,
        }
        self.loop = setup.vary(kept | changed)
        rounds = self.loop.sensor.bits is not None or self.loop.signal_path.bits is not None
        self.key_step = _KEY_STEP_ROUNDED if rounds else _KEY_STEP
        self.phase_period = self.loop.sensor.every_steps

    def spec_of(self, values: Mapping[str, float]) -> PlantSpec:
        """Return the plant with other values of some scene keys. Raises SceneError."""
        return self.spec_with(self.loop.vary(values).mechanics if values else self.loop.mechanics)

    def _relevant(self, values: Mapping[str, float]) -> Mapping[str, float]:
        return values

    def _simulate(
        self, values: Mapping[str, float], until_s: float, phase: float
    ) -> SimulatedImpact:
        loop = self.loop.vary(values) if values else self.loop
        spec = self.spec_with(loop.mechanics)
        horizon = 1 + loop.signal_path.latency_steps + loop.signal_path.most_added_steps
        samples = _LEAD_SAMPLES + int(getattr(loop.scene.controller.keys, "window_samples", 0))
        lead = loop.sensor.every_steps * (
            samples + math.ceil(_HORIZONS * horizon / loop.sensor.every_steps)
        )
        before = lead * self.parts + phase * self.parts
        spec = replace(spec, lead_in_s=(math.floor(before) + 0.5) * spec.step_s)
        plant = self.plant_of(spec, before - math.floor(before))
        steps = lead + math.ceil(phase + until_s / self.loop_step_s) + 4
        truth = finer_loop(loop, plant, steps, self.parts)
        time_s = (np.arange(truth.shape[1]) - before) * spec.step_s
        return self.as_impact(spec, plant, time_s, truth)

    def acts(self, values: Mapping[str, float], until_s: float) -> bool:
        """Whether the actuator acts on the plate before `until_s` after the touch."""
        truth = self.run(values, until_s).truth
        return float(np.max(np.abs(truth[F_A]))) > _ACTS
