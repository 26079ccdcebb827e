"""The simulation of a fit under a law: the closed loop on the frozen model of the plate.

Sensor, law and line keep the steps of the scene. The plant takes several steps in each of them, so
that a record is as exact as that of a drop without control. Where in a sampling period the sphere
touches the plate is not known of a record; it is the `phase`, in steps of the scene.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hertzloop.identification.fit.model import FrozenModel, SimulatedImpact
from hertzloop.identification.records.errors import RecordError
from hertzloop.identification.records.record import Record
from hertzloop.loop.simulate import finer_loop
from hertzloop.plant.plant import PlantSpec
from hertzloop.results.statistics import control_force_n
from hertzloop.scene.setup import Setup, resolve

PLANT_NS = 250  # longest step of the plant
_LEAD_SAMPLES = 8  # before the touch; more for the window and the horizon of the law
_HORIZONS = 3
_ROOM_S = 0.01  # added to the run, so that a latency of the search is not longer than it
_ACTS = 1e-12  # N
# What changes the force of the actuator alone, beside all keys of the controller.
_OF_ACTUATOR = ("bandwidth_hz", "damping", "force_limit_n", "dead_time_us")
_NOT_OF_ONE_RUN = ("jitter_us", "drop_out_probability")


def is_control_key(key: str) -> bool:
    """Whether a key changes nothing but the force of the actuator."""
    table, _, last = key.partition(".")
    return table == "controller" or (table == "actuator" and last != "mass_kg")


def why_not_free(key: str) -> str | None:
    """Why a key of controller or actuator cannot be free under a law; None if it can."""
    table, _, last = key.partition(".")
    if table == "controller" and last in _NOT_OF_ONE_RUN:
        return "a record of one run cannot tell it. Set it with --set"
    if table == "actuator" and last not in (*_OF_ACTUATOR, "mass_kg"):
        return f"of the actuator only {', '.join((*_OF_ACTUATOR, 'mass_kg'))} can be free"
    return None


def resolution_us(setup: Setup, key: str) -> float | None:
    """How far apart the values of a key in whole steps are, us; None of another key."""
    table, _, last = key.partition(".")
    if key == "actuator.dead_time_us" or (
        table == "controller" and last in setup.scene.controller.whole_step_keys
    ):
        return setup.step_ns / 1000
    return None


def refuse_unknown_loop(setup: Setup) -> None:
    """Raise RecordError for a loop of which no two runs are alike, or without a law."""
    control, sensors = setup.scene.controller, setup.scene.sensors
    if not setup.has_law:
        raise RecordError(
            "controller.law = off: a record is under control. Name the law, --set "
            "controller.law=NAME, or write control = false in the record table."
        )
    chance: dict[str, Any] = {
        "controller.jitter_us": control.jitter_us,
        "controller.drop_out_probability": control.drop_out_probability,
        "controller.latency_trace": control.latency_trace,
        "sensors.fault": sensors.fault,
    }
    for key, value in chance.items():
        if value:
            raise RecordError(
                f"{key} = {value}: a fit simulates one run, and what chance or a fault did in it "
                "is not known. Leave the key out."
            )


def refuse_incomparable(record: Record, setup: Setup) -> None:
    """Raise RecordError for a record that the simulation under a law cannot be compared with."""
    measurement, actuator = record.measurement, setup.actuator
    if measurement.point_m is not None:
        raise RecordError(
            f"record.point_m = {list(measurement.point_m)}: under a law {record.name} must be of "
            "the contact point or of the actuator's force."
        )
    held = actuator.bandwidth_hz is None
    filtered = measurement.low_pass_hz is not None or measurement.resonance_hz is not None
    if record.quantity == "actuator_force" and held and not filtered:
        raise RecordError(
            f"{record.name}: without a bandwidth the actuator's force jumps at every step, which "
            "no sensor shows. Give actuator.bandwidth_hz, or record.low_pass_hz, the bandwidth of "
            "the sensor."
        )
    moving = [q for q in (record.quantity, setup.quantity) if q in ("v_p", "acceleration")]
    if moving and held:
        raise RecordError(
            f"{record.name}: without a bandwidth the actuator's force jumps at every step, and the "
            f"{moving[0]} that is {'recorded' if moving[0] == record.quantity else 'fed back'} "
            "jumps with it, by as much as the plate has modes. Give actuator.bandwidth_hz."
        )


class LoopModel(FrozenModel):
    """Simulations of one scene under its law, with other values of its keys.

    Args:
        setup: the starting point, with its law.
        duration_s: the longest time after the touch that will be asked for, s.
        accuracy: relative error that leaving out modes may cause.
        plant_ns: longest step of the plant.
    """

    def __init__(
        self, setup: Setup, duration_s: float, accuracy: float, plant_ns: int = PLANT_NS
    ) -> None:
        self.parts = math.ceil(setup.step_ns / plant_ns)
        # The plant alone: times of the loop need not be whole steps of the plant.
        alone = setup.plant_only().scene
        ideal = alone.actuator.replaced(dead_time_us=None)
        super().__init__(
            resolve(alone.replaced(actuator=ideal)),
            duration_s,
            accuracy,
            step_ns=max(1, round(setup.step_ns / self.parts)),
        )
        self.loop_step_s = setup.step_s
        self.spec = replace(self.spec, step_s=setup.step_s / self.parts)
        kept = {
            f"run.{key}": getattr(self.setup.scene.run, key)
            for key in ("scheme", "plate_model", "accuracy")
        }
        changed = {
            "plate.theory": self.setup.theory,
            "sensors.noise_rms": 0.0,
            "run.touch_phase": 0.5,
            "run.duration_s": max(setup.duration_s, 2.0 * duration_s) + _ROOM_S,
        }
        self.loop = setup.vary(kept | changed)

    @property
    def period(self) -> int:
        """Steps of the scene from sample to sample: the range of a phase."""
        return self.loop.every_steps

    @property
    def converts(self) -> bool:
        """Whether a converter rounds what the law reads or commands."""
        return self.loop.sensor.bits is not None or self.loop.line.bits is not None

    def spec_of(self, values: Mapping[str, float]) -> PlantSpec:
        """Return the plant with other values of some scene keys. Raises SceneError."""
        return self.spec_with(self.loop.vary(values).mechanics if values else self.loop.mechanics)

    def run(
        self, values: Mapping[str, float], until_s: float, phase: float = 0.5
    ) -> SimulatedImpact:
        """Simulate the drop with other values of some keys until `until_s` after the touch.

        Raises:
            SceneError: a value that the scene refuses, or a law that fails.
        """
        phase %= self.period
        key = (tuple(sorted(values.items())), until_s, round(phase, 9))
        return self.kept(key, lambda: self._looped(values, until_s, phase))

    def _looped(self, values: Mapping[str, float], until_s: float, phase: float) -> SimulatedImpact:
        self.simulations += 1
        loop = self.loop.vary(values) if values else self.loop
        spec = self.spec_with(loop.mechanics)
        horizon = 1 + loop.line.latency_steps + loop.line.most_added_steps
        samples = _LEAD_SAMPLES + int(getattr(loop.scene.controller.keys, "window_samples", 0))
        lead = loop.every_steps * (samples + math.ceil(_HORIZONS * horizon / loop.every_steps))
        before = lead * self.parts + phase * self.parts
        spec = replace(spec, lead_in_s=(math.floor(before) + 0.5) * spec.step_s)
        plant = self.plant_of(spec, before - math.floor(before))
        steps = lead + math.ceil(phase + until_s / self.loop_step_s) + 4
        rows = finer_loop(loop, plant, steps, self.parts)
        time_s = (np.arange(rows.shape[1]) - before) * spec.step_s
        return self.simulated(spec, plant, time_s, rows)

    def acts(self, values: Mapping[str, float], until_s: float) -> bool:
        """Whether the actuator acts on the plate before `until_s` after the touch."""
        rows = self.run(values, until_s).rows
        return float(np.max(np.abs(control_force_n(self.loop, rows)))) > _ACTS


def control_notes(setup: Setup, names: list[str]) -> Iterator[str]:
    """Sentences on what a simulation under a law supposes of some records."""
    law = setup.law_reference
    yield (
        f"{', '.join(names)}: simulated under the law '{law}'. Write control = false in the record "
        "table if the law was off."
    )
    if setup.scene.sensors.noise_rms:
        yield (
            f"sensors.noise_rms = {setup.scene.sensors.noise_rms:g}: taken as zero, since the "
            "noise that the law read is not known. What it does to the force counts as misfit."
        )
