"""From a checked scene to the parts: plant, sensor, controller."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from controller.door.law import LawError
from controller.law import About, Reach
from hertzloop.plant_tables import actuator_of, contact_of
from hertzloop.plate_choice import (
    check_build,
    check_lowest,
    check_modes,
    check_reach,
    check_step,
    limit_hz_of,
)
from hertzloop.quantities import SENSED, Expected
from hertzloop.scenes.scene import Scene, SceneError
from hertzloop.scenes.shared import by_tables
from hertzloop.struck import impedance_n_s_m, structure
from plant.contact.hertz import (
    GRAVITY_M_S2,
    Sphere,
    rigid_contact_time_s,
    rigid_peak_force_n,
    rigid_penetration_m,
)
from plant.contact.yielding import deepest_rigid_m, yield_depth_m
from plant.estimates.model_order import expected_error, expected_solid_error, held_error
from plant.estimates.reflections import Actuation, Reflections, reflections
from plant.plant import Plant, PlantSpec
from plant.schemes.infinite import InfinitePlant
from plant.schemes.registry import SCHEMES
from plant.schemes.thesis2008 import ThesisPlant
from plant.structures.modal_structure import ModalStructure
from plant.structures.plate import Plate
from plant.structures.solid_plate import SolidPlate
from plant.structures.structure import Structure
from sensors.acquisition import Sensor, SensorSpec

PHASE_STREAM = 4  # random stream; sensor and controller have others
# A law that looks ahead, as `predicted`, watches from twice the flight in its horizon on.
_HORIZONS, _LEAST_FLIGHT_S = 2.5, 20e-6
_LONGER = 2.0  # the delay that a law may latch, against the contact without control


def plant_spec(scene: Scene) -> PlantSpec:
    """Description of the plant. Raises SceneError if the scene asks for too many modes."""
    return _infinite_spec(scene) if plate_model(scene) == "infinite" else _modal_spec(scene)


# Contact, actuator and more decide on plate.theory = "auto".
_OF_BODIES = (
    "sphere", "plate", "contact", "actuator", "materials",
    "run.scheme", "run.plate_model", "run.accuracy",
)  # fmt: skip
_OF_PLANT = (*_OF_BODIES, "run.step_ns", "run.lead_in_s")


@by_tables(*_OF_PLANT)
def _infinite_spec(scene: Scene) -> PlantSpec:
    spec = _described(scene)
    if isinstance(spec.plate, Plate):
        check_lowest(scene, spec.plate, spec.frequency_limit_hz)
    return replace(spec, residual_flexibility=False, damped_tail=False, infinite_plate=True)


@by_tables(*_OF_PLANT)
def _modal_spec(scene: Scene) -> PlantSpec:
    """The plant with the modes of the structure."""
    spec = _described(scene)
    if isinstance(spec.plate, ModalStructure):
        check_reach(spec.plate, spec.sphere, spec.contact, spec.frequency_limit_hz)
    else:
        check_modes(scene, spec.plate, spec.frequency_limit_hz)
    check_build(spec)
    return spec


@by_tables(*_OF_PLANT)
def _described(scene: Scene) -> PlantSpec:
    """Describe the plant; whether its modes can be computed is not checked."""
    sphere, plate = _bodies(scene)
    table = scene.plate
    contact = contact_of(scene, sphere, plate)
    check_step(scene, sphere, contact)
    limit, damped = limit_hz_of(scene, sphere, plate, contact)
    if isinstance(plate, ModalStructure):
        limit = min(plate.highest_hz, 0.5 / scene.step_s)
    return PlantSpec(
        sphere=sphere,
        plate=plate,
        contact=contact,
        contact_point_m=table.points_m[0],
        actuator_point_m=table.points_m[1],
        step_s=scene.step_s,
        frequency_limit_hz=limit,
        lead_in_s=scene.run.lead_in_s,
        residual_flexibility=SCHEMES[scene.run.scheme].tail,
        damped_tail=damped,
        actuator=actuator_of(scene),
        radiating_faces=table.radiating_faces,
    )


@by_tables(*_OF_BODIES)
def _bodies(scene: Scene) -> tuple[Sphere, Structure]:
    ball = scene.sphere
    return Sphere(scene.material("sphere"), ball.radius_m, ball.drop_height_m), structure(scene)


def touch_phase(scene: Scene) -> float:
    """Part of a step from the last sample above the plate to the first touch: the scene's, or
    drawn by its seed."""
    phase = scene.run.touch_phase
    if phase == "random":
        key = [scene.run.seed, PHASE_STREAM]
        return float(np.random.Generator(np.random.Philox(key=key)).random())
    return phase


def plant_of(spec: PlantSpec, scene: Scene) -> Plant | ThesisPlant:
    """A plant by the scene's scheme. Raises ValueError for what that scheme does not know."""
    if scene.run.scheme == "thesis2008":
        return ThesisPlant(spec, scene.steps)
    return built(spec, scene.run.scheme).at_start(touch_phase(scene))


def plant(scene: Scene) -> Plant | ThesisPlant:
    """The plant at the start of its run."""
    try:
        return plant_of(plant_spec(scene), scene)
    except ValueError as error:
        raise SceneError(str(error)) from error


@lru_cache(maxsize=8)
def built(spec: PlantSpec, scheme: str) -> Plant:
    """A plant whose model is shared by all runs of the same description."""
    return InfinitePlant(spec) if spec.infinite_plate else SCHEMES[scheme].load()(spec)


def model_error(scene: Scene) -> float:
    """Relative error of penetration or plate energy that leaving out modes, or the reflections, is
    expected to cost; under a law at least what the steps of its force do."""
    spec = plant_spec(scene)
    if spec.infinite_plate:
        return infinite_plate_error(scene)
    if isinstance(spec.plate, SolidPlate):
        return expected_solid_error(spec.sphere, spec.plate, spec.contact, spec.frequency_limit_hz)
    found = expected_error(
        spec.sphere, spec.plate, spec.contact, spec.frequency_limit_hz,
        spring=spec.residual_flexibility, damped=spec.damped_tail,
    )  # fmt: skip
    return max(found, _held_error(scene, spec)) if spec.residual_flexibility else found


def _held_error(scene: Scene, spec: PlantSpec) -> float:
    """What a law's force, held from sample to sample, costs; a bandwidth rounds its steps."""
    reach = law_reach(scene)
    if reach.force_n < math.inf:
        return 0.0
    hold_s = scene.step_s * scene.sensors.every_steps
    rounded = min(1.0, ((spec.actuator.bandwidth_hz or math.inf) * hold_s) ** 2)
    share = min(reach.share, 1.0) * rounded
    return held_error(spec.sphere, spec.contact, share, hold_s, damped=spec.damped_tail)


def plate_model(scene: Scene) -> str:
    """The model of the plate, "modal" or "infinite", that a scene's `run.plate_model` means.

    "auto" is "infinite" where the run ends after the first contact, but before the
    reflections matter at the accuracy asked for; a run without contact keeps the modes.
    """
    chosen = scene.run.plate_model
    if chosen != "auto":
        return chosen
    return "infinite" if infinite_plate_error(scene) <= scene.run.accuracy else "modal"


def infinite_plate_error(scene: Scene) -> float:
    """Error that an infinite plate is expected to have at the run's end, relative to the
    penetration or the plate energy; inf where it is not known, as while the contact lasts."""
    until_s = scene.run.duration_s - first_touch_s(scene)
    reach = law_reach(scene)
    if until_s <= 0.0 or not _infinite_plate_possible(scene, reach):
        return math.inf
    found = _reflections(scene)
    if not found.contact_s <= until_s:
        return math.inf
    return found.error(until_s, scene.step_s, _actuation(scene, reach, found))


def infinite_plate_lasts_s(scene: Scene) -> float:
    """How long after the first touch an infinite plate meets the scene's accuracy, s; zero where
    it does not do so for a whole contact."""
    reach = law_reach(scene)
    if not _infinite_plate_possible(scene, reach):
        return 0.0
    found = _reflections(scene)
    lasts_s = found.lasts_s(scene.run.accuracy, scene.step_s, _actuation(scene, reach, found))
    return lasts_s if lasts_s >= found.contact_s else 0.0


def first_touch_s(scene: Scene) -> float:
    """When the sphere first touches the plate, from the start of the run, to a step, s."""
    fall_s = _bodies(scene)[0].impact_speed_m_s / GRAVITY_M_S2
    return min(scene.run.lead_in_s, fall_s)


@by_tables(*_OF_BODIES)
def _reflections(scene: Scene) -> Reflections:
    sphere, plate = _bodies(scene)
    if not isinstance(plate, Plate):
        raise SceneError(f"reflections are not known for {plate}")
    point = scene.plate.points_m[0]
    return reflections(sphere, plate, contact_of(scene, sphere, plate), point)


def _infinite_plate_possible(scene: Scene, reach: Reach) -> bool:
    """Whether the infinite plate can stand for the modes at all: reflections are known of simply
    supported edges, and a force of more than the contact's own has no known limit."""
    contact, actuator = scene.plate.points_m
    bounded = reach.force_n < math.inf or reach.share <= 1.0
    supported = isinstance(_bodies(scene)[1], Plate)
    ideal = actuator_of(scene).ideal and scene.contact.plasticity == "none"
    known = scene.run.scheme == "modal" and ideal and not scene.plate.radiating_faces
    return known and contact == actuator and bounded and supported


def _actuation(scene: Scene, reach: Reach, found: Reflections) -> Actuation:
    """What the actuator may do.

    A law that copies the contact force is as smooth as that, unless the line from sensor to
    actuator is not, with a delay of at most a contact, which it makes longer; any other counts
    as switched on and off at the largest force.
    """
    control, sensors = scene.controller, scene.sensors
    if reach.force_n < math.inf:
        return Actuation(jumps_n=2.0 * reach.force_n)
    line_is_smooth = (
        sensors.bits == control.bits == "ideal"
        and sensors.every_steps == 1
        and sensors.noise_rms == control.jitter_us == 0.0
        and control.drop_out_probability == 0.0
        and control.slew_n_s is None
    )
    if reach.copies and line_is_smooth:
        delay_s = _LONGER * found.contact_s + 1e-6 * control.latency_us
        return Actuation(reach.share, delay_s)
    sphere, plate = _bodies(scene)
    s = contact_of(scene, sphere, plate).stiffness
    peak_n = rigid_peak_force_n(sphere.mass_kg, s, sphere.impact_speed_m_s)
    return Actuation(jumps_n=2.0 * reach.share * peak_n)


def law_reach(scene: Scene) -> Reach:
    """How far the force of the scene's law can go; without limit if the law is not there any more,
    as that of a recording may be. Raises SceneError."""
    try:
        law = scene.law
    except SceneError:
        return Reach()
    try:
        return law.reach(scene.controller.keys)
    except LawError as error:
        raise SceneError(str(error)) from error


def about_bodies(scene: Scene, stiffness: float, **more: Any) -> About:
    """What a law may know of a run, with the contact's `stiffness` (N/m^1.5), and `more` of what
    takes a simulation or the range of the converter."""
    limit_n = scene.controller.full_scale_n
    return replace(
        _about_impact(scene, stiffness),
        step_ns=scene.run.step_ns,
        every_steps=scene.sensors.every_steps,
        # The force of a sample acts one step after it at the earliest.
        horizon_steps=1 + scene.in_steps(scene.controller.latency_us),
        limit_n=math.inf if limit_n is None else limit_n,
        **more,
    )


@by_tables(*_OF_BODIES)
def _about_impact(scene: Scene, stiffness: float) -> About:
    """What a law may know of the bodies alone."""
    sphere, plate = _bodies(scene)
    m, v = sphere.mass_kg, sphere.impact_speed_m_s
    local = plate.local_plate
    return About(
        stiffness=stiffness,
        sphere_mass_kg=m,
        impact_speed_m_s=v,
        impedance_n_s_m=local.infinite_plate_impedance_n_s_m if local else math.nan,
        rigid_contact_s=rigid_contact_time_s(m, stiffness, v),
        rigid_peak_n=rigid_peak_force_n(m, stiffness, v),
        yield_depth_m=yield_depth_m(contact_of(scene, sphere, plate)),
    )


@by_tables(*_OF_PLANT, "sensors", "controller.latency_us")
def full_scale(scene: Scene) -> tuple[float, float] | None:
    """Range of the converter in units of its quantity; None without limits.

    "contact" takes the largest value of the contact on a rigid plate as its measure: F, its
    penetration (deeper where it yields), F/Z of the plate's velocity, and pi/T times that of its
    acceleration. "auto" is the same with the flight above the plate that a law has to see: that
    of the horizon with a window, and of 20 us at least.
    """
    table = scene.sensors
    if isinstance(table.full_scale, tuple):
        return table.full_scale
    if table.full_scale == "none" or table.bits == "ideal":
        return None
    spec = _described(scene)
    m, v = spec.sphere.mass_kg, spec.sphere.impact_speed_m_s
    rigid, flight_s = rigid_penetration_m(m, spec.contact.stiffness, v), 0.0
    if table.full_scale == "auto":
        horizon_s = scene.step_s + 1e-6 * scene.controller.latency_us
        flight_s = max(_HORIZONS * horizon_s, _LEAST_FLIGHT_S)
    force_n = spec.contact.stiffness * rigid**1.5
    return SENSED[table.quantity].range(
        Expected(
            rigid_m=rigid,
            deepest_m=max(rigid, deepest_rigid_m(spec.contact, 0.5 * m * v * v)),
            flight_m=v * flight_s,
            force_n=force_n,
            velocity_m_s=lambda: force_n / impedance_n_s_m(spec.plate),
            contact_s=rigid_contact_time_s(m, spec.contact.stiffness, v),
        )
    )


def sensor(scene: Scene) -> Sensor:
    """The data-acquisition channel at the start of its run."""
    table = scene.sensors
    spec_ = SensorSpec(
        of_state=SENSED[table.quantity].of_state,
        every_steps=table.every_steps,
        low_pass_hz=table.low_pass_hz,
        full_scale=full_scale(scene),
        bits=None if table.bits == "ideal" else int(table.bits),
        noise_rms=table.noise_rms,
    )
    return Sensor(spec_, scene.step_s, scene.steps, scene.run.seed)
