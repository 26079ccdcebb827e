"""Simulate the impact of a scene with other values of its keys, on frozen modes of the plate.

A fit changes keys by a ten-thousandth and compares. The choice of the modes must not change on the
way: each mode that enters would make a jump. So truncated modes and number of modes are
those of the starting point; only the frequencies move.

Under a law, sensor, law and signal path keep the steps of the scene. The plant takes several steps
in each of them, so that a record is as exact as that of a drop without control. Where in a sampling
period the sphere touches the plate is not known of a record; it is the `phase`, in steps of the
scene.
"""

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from hertzloop.closed_loop.parts import series_under
from hertzloop.fitting.fit.free_keys import drop_values
from hertzloop.fitting.fit.simulated_impact import SimulatedImpact
from hertzloop.loop.simulate import simulate
from hertzloop.plant import state_kernels
from hertzloop.plant import time_series as ts
from hertzloop.plant.actuator import build_model
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.factory import plant_at_start
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.structure import frequencies
from hertzloop.plant.time_series import F_A
from hertzloop.scene.build import check_modes_reach_impact
from hertzloop.scene.errors import SceneError
from hertzloop.scene.mechanics import Mechanics
from hertzloop.scene.setup import Setup, resolve

LEAD_IN_S = 2e-6  # flight before the touch; the plate is at rest until then
PHASE = 0.5
_FINE_NS, _MIDDLE_NS, _COARSE_NS = 250, 500, 1000
_FINE_UNTIL_S, _MIDDLE_UNTIL_S = 4e-3, 15e-3
_LONG_CONTACT_S = 150e-6  # four times as many steps as a contact of 30 us at 250 ns
# Error of the plate's velocity at the contact point during contact, root mean square over the peak:
# the first over the square of the periods of the modes' limit in a contact, and the second times
# the square of the step over the contact time. In 18 random impacts on thin plates, elastic and
# yielding, the first was 0.05 to 0.09; a heavy ball on a light plate has more, but its
# contact lasts longer. The second was 0.5 to 0.9 in five impacts.
_BY_MODES, _BY_STEPS = 0.06, 0.9
_SHORTEST_NS = 30
_MOST_WORK = 8e7  # frequencies times steps of one simulation, about 50 ms
_COARSER = 1.3
_KEPT_PLANTS = 24
_KEPT_RUNS = 64
_NEXT_MODE = 1.02  # how far above the limit the next mode is looked for
_KEY_STEP = 1e-4  # of a derivative by the logarithm of a key
PLANT_NS = 250  # longest step of the plant
_LEAD_SAMPLES = 8  # before the touch; more for the window and the horizon of the law
_HORIZONS = 3
_ROOM_S = 0.01  # added to the run, so that a latency of the search is not longer than it
_ACTS = 1e-12  # N
_KEY_STEP_UNDER_LAW = 2e-3  # the same under a law, and where a converter of the loop rounds
_KEY_STEP_ROUNDED = 3e-2


class ImpactSimulator:
    """Simulates the impact of one scene with other values of its keys, on frozen modes.

    Args:
        setup: the starting point; its law is switched off.
        duration_s: the longest time after the touch that will be asked for, s.
        accuracy: relative error that leaving out modes may cause.
        point_m: where plate motion is measured, or None for the contact point, m.
        step_ns: length of a step; by contact and duration if left out.
        velocity_error: error of the plate's velocity at the contact point during contact, root
            mean square over the peak, that steps and modes are refined for.

    Attributes:
        velocity_error: estimate of this error; larger where refinement would cost too much.
        key_step: of a derivative by the logarithm of a key.
        looped: whether the impact is under a law, and the phase matters.
        phase_period: range of the phase, in steps of the scene; one without a law.
        simulations: number of simulations so far.

    Raises:
        SceneError: the scene cannot be simulated.
    """

    looped = False

    def __init__(
        self,
        setup: Setup,
        duration_s: float,
        accuracy: float,
        point_m: tuple[float, float] | None = None,
        step_ns: int | None = None,
        velocity_error: float | None = None,
    ) -> None:
        free = setup.without_control()
        lasts_s = rigid_impact(free.mechanics.sphere, free.mechanics.contact).contact_s
        self.step_ns = step_ns or _step_ns(lasts_s, duration_s)
        self.contact_s = lasts_s
        changed: dict[str, Any] = {
            "run.scheme": "modal",
            "run.plate_model": "modal",
            "run.lead_in_s": LEAD_IN_S,
            "run.touch_phase": PHASE,
            "run.step_ns": self.step_ns,
            "run.accuracy": accuracy,
            "run.duration_s": 2.0 * LEAD_IN_S + duration_s,
        }
        if free.scene.contact.plasticity == "auto":
            changed["contact.plasticity"] = (
                "none" if free.mechanics.contact.limit is None else "thornton"
            )
        if point_m is not None and free.mechanics.structure.mode_table is None:
            changed["plate.actuator_point_m"] = point_m
        self.setup = free.vary(changed)
        self.away_from_contact = point_m is not None
        self.spec = self._with_actuator_at_sensor(self.setup.plant)
        check_modes_reach_impact(self.spec)
        if velocity_error is not None:
            self._refine(velocity_error, changed["run.duration_s"])
        self.velocity_error = self._velocity_error(self.step_ns, self.spec.frequency_limit_hz)
        self._limit_hz = _between_modes(self.spec)
        self._scale = _frequency_scale(self.spec)
        self._plants: dict[Any, Any] = {}
        self._runs: dict[Any, SimulatedImpact] = {}
        self.simulations, self.key_step, self.phase_period = 0, _KEY_STEP, 1

    def _velocity_error(self, step_ns: int, limit_hz: float) -> float:
        by_modes = _BY_MODES / (limit_hz * self.contact_s) ** 2
        return math.hypot(by_modes, _BY_STEPS * (1e-9 * step_ns / self.contact_s) ** 2)

    def _refine(self, error: float, duration_s: float) -> None:
        """Use shorter steps and more modes, as far as one simulation may cost."""
        spec, coarsest_ns = self.spec, self.step_ns
        while self._velocity_error(self.step_ns, self.spec.frequency_limit_hz) > error:
            share = math.sqrt(0.5) * error
            longest_ns = 1e9 * self.contact_s * math.sqrt(share / _BY_STEPS)
            step_ns = coarsest_ns
            while step_ns > max(longest_ns, _SHORTEST_NS):
                step_ns //= 2
            limit_hz = spec.frequency_limit_hz
            if spec.plate.mode_table is None:
                wanted_hz = math.sqrt(_BY_MODES / share) / self.contact_s
                limit_hz = max(limit_hz, min(wanted_hz, 0.5e9 / step_ns, spec.plate.highest_hz))
            oscillators = frequencies(
                spec.plate, spec.contact_point_m, spec.actuator_point_m, 2.0 * math.pi * limit_hz
            )
            if oscillators * duration_s * 1e9 / step_ns <= _MOST_WORK:
                if step_ns != coarsest_ns:
                    self.setup = self.setup.vary({"run.step_ns": step_ns})
                    self.step_ns = step_ns
                self.spec = replace(
                    self._with_actuator_at_sensor(self.setup.plant), frequency_limit_hz=limit_hz
                )
                return
            error *= _COARSER

    def _with_actuator_at_sensor(self, spec: PlantSpec) -> PlantSpec:
        """Return the plant with its actuator at the measuring point, where the motion is known."""
        return replace(spec, plate=spec.plate.pushed_at_sensor) if self.away_from_contact else spec

    def spec_of(self, values: Mapping[str, float]) -> PlantSpec:
        """Return the plant with other values of some scene keys. Raises SceneError."""
        own = self._relevant(values)
        return self.spec_with(self.setup.vary(own).mechanics if own else self.setup.mechanics)

    def spec_with(self, bodies: Mechanics) -> PlantSpec:
        """Return the plant with other bodies, with the frozen modes of the plate."""
        spec = replace(
            self.spec,
            sphere=bodies.sphere,
            plate=bodies.structure,
            contact=bodies.contact,
            contact_point_m=bodies.contact_point_m,
            actuator_point_m=bodies.actuator_point_m,
            actuator=bodies.actuator,
            sensor_point_m=bodies.sensor_point_m,
        )
        spec = self._with_actuator_at_sensor(spec)
        limit_hz = self._limit_hz * _frequency_scale(spec) / self._scale
        spec = replace(spec, frequency_limit_hz=min(limit_hz, spec.plate.highest_hz))
        check_modes_reach_impact(spec)
        return spec

    def run(
        self, values: Mapping[str, float], until_s: float, phase: float = PHASE
    ) -> SimulatedImpact:
        """Simulate the drop with other values of some keys until `until_s` after the touch.

        Args:
            values: scene keys; those that the simulation does not depend on have no effect.
            until_s: end of the simulation after the touch, s.
            phase: from the last sample of a law to the touch, in steps; no effect without a law.

        Raises:
            SceneError: a value that the scene refuses, or a law that fails.
        """
        values, phase = self._relevant(values), phase % self.phase_period
        key = tuple(sorted(values.items())), until_s, round(phase, 9)
        if key not in self._runs:
            self.simulations += 1
            found = self._simulate(values, until_s, phase)
            if len(self._runs) >= _KEPT_RUNS:
                self._runs.pop(next(iter(self._runs)))
            self._runs[key] = found
        return self._runs[key]

    def _relevant(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """Return the scene keys that the simulation depends on."""
        return drop_values(values)

    def _simulate(
        self, values: Mapping[str, float], until_s: float, phase: float
    ) -> SimulatedImpact:
        return self.run_spec(self.spec_of(values), until_s)

    def run_spec(self, spec: PlantSpec, until_s: float) -> SimulatedImpact:
        """Simulate the drop of another plant until `until_s` after the touch."""
        steps = 16 + math.ceil((until_s + LEAD_IN_S) * 1e9 / self.step_ns)
        plant = self.plant_of(spec)
        truth = series_under(plant, np.zeros(1), steps)
        time_s = np.arange(steps) * spec.step_s - _lead_s(spec)
        return self.as_impact(spec, plant, time_s, truth)

    def as_impact(
        self, spec: PlantSpec, plant: Any, time_s: np.ndarray, truth: np.ndarray
    ) -> SimulatedImpact:
        """Return the rows of a plant as a simulated drop."""
        sphere, mobility = spec.sphere, float(plant.model.linear.direct[0, 0])
        pushed = mobility if spec.same_point and np.any(truth[ts.F_A]) else 0.0
        held = spec.actuator.bandwidth_hz is None
        return SimulatedImpact(
            time_s,
            truth,
            spec.contact,
            sphere.impact_speed_m_s,
            GRAVITY_M_S2,
            mobility,
            pushed,
            held,
        )

    def plant_of(self, spec: PlantSpec, phase: float = PHASE) -> Any:
        """The plant at the start of the drop; its modes are computed once for a structure.

        Raises:
            SceneError: the plant cannot be built.
        """
        from hertzloop.plant.schemes.modal import with_contact

        key = (
            spec.plate,
            spec.frequency_limit_hz,
            spec.contact_point_m,
            spec.actuator_point_m,
            spec.actuator.mass_kg,
            spec.sensor_point_m,
        )
        base = self._plants.get(key)
        if base is None:
            try:
                base = plant_at_start(spec, "modal", 1, PHASE)
            except ValueError as error:
                raise SceneError(str(error)) from error
            if len(self._plants) >= _KEPT_PLANTS:
                self._plants.pop(next(iter(self._plants)))
            self._plants[key] = base
        new = copy(base)
        new.spec = spec
        new.model = with_contact(base.model, spec)
        if spec.actuator != base.spec.actuator:
            new.model = new.model._replace(actuator=build_model(spec.actuator, spec.step_s))
        return new.at_start(phase)


def _lead_s(spec: PlantSpec) -> float:
    """Flight before the touch, s, as the plant rounds it."""
    speed_m_s, g = spec.sphere.impact_speed_m_s, GRAVITY_M_S2
    fall_s = speed_m_s / g
    height, _ = state_kernels.released(speed_m_s, g, spec.lead_in_s, spec.step_s, PHASE)
    # Height = lead (v - g lead/2); the smaller root is the lead.
    root = math.sqrt(max(speed_m_s**2 - 2.0 * g * float(height), 0.0))
    return min(2.0 * float(height) / (speed_m_s + root), fall_s)


def _step_ns(contact_s: float, duration_s: float) -> int:
    if contact_s > _LONG_CONTACT_S or duration_s > _MIDDLE_UNTIL_S:
        return _COARSE_NS if contact_s > 10e-6 else _MIDDLE_NS
    if duration_s > _FINE_UNTIL_S:
        return _MIDDLE_NS
    return _FINE_NS


def _frequency_scale(spec: PlantSpec) -> float:
    """What all frequencies of a plate are proportional to as its sizes and material change."""
    plate = spec.plate.local_plate
    if plate is None or spec.plate.mode_table is not None:
        return 1.0
    speed = math.sqrt(plate.bending_stiffness_n_m / plate.mass_per_area_kg_m2)
    return speed / (plate.size_m[0] * plate.size_m[1])


def _between_modes(spec: PlantSpec) -> float:
    """The limit, moved to the middle between two modes: rounding must not decide on one."""
    if spec.plate.local_plate is None or spec.plate.mode_table is not None:
        return spec.frequency_limit_hz
    limit = 2.0 * math.pi * spec.frequency_limit_hz
    highest = min(_NEXT_MODE * limit, 2.0 * math.pi * spec.plate.highest_hz)
    omega = spec.plate.modes(highest, spec.contact_point_m, spec.actuator_point_m).omega
    above = omega[omega > limit * (1.0 + 1e-9)]
    below = omega[omega < limit * (1.0 + 1e-9)]
    if not len(above) or not len(below):
        return spec.frequency_limit_hz
    return 0.5 * float(above[0] + below[-1]) / (2.0 * math.pi)


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
        alone = setup.plant_only()
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
        self.key_step = _KEY_STEP_ROUNDED if rounds else _KEY_STEP_UNDER_LAW
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
        truth = simulate(loop, own_plant=plant, steps=steps, parts_of_step=self.parts).truth
        time_s = (np.arange(truth.shape[1]) - before) * spec.step_s
        return self.as_impact(spec, plant, time_s, truth)

    def acts(self, values: Mapping[str, float], until_s: float) -> bool:
        """Whether the actuator acts on the plate before `until_s` after the touch."""
        truth = self.run(values, until_s).truth
        return float(np.max(np.abs(truth[F_A]))) > _ACTS
