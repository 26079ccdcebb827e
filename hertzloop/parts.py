"""From a checked scene to the parts: plant, sensor, controller."""

import math
from dataclasses import replace
from functools import lru_cache

from controller.controller import Controller, Law, LawSpec, LineSpec
from controller.threshold import shifted_threshold_m_s
from hertzloop.scene import SENSED, Scene, SceneError
from plant.collocation import CollocationPlant
from plant.contact import (
    GRAVITY_M_S2,
    Contact,
    Damping,
    Sphere,
    hertz_stiffness,
    hunt_crossley_parameter,
    rigid_contact_time_s,
    rigid_peak_force_n,
)
from plant.infinite import InfinitePlant
from plant.materials import MATERIALS
from plant.model_order import expected_error, frequency_limit_hz
from plant.plant import Plant, PlantSpec
from plant.plate import Plate
from plant.reflections import Actuation, Reflections, reflections
from plant.thesis2008 import ThesisPlant
from sensors.acquisition import Quantity, Sensor, SensorSpec

_MAX_MODES = 500_000
# Ranges of converters, of the largest value on a rigid plate.
_GAP_LOW, _GAP_HIGH, _ABOVE = -1.25, 0.25, 1.25
_LONGER = 2.0  # the delay that a law may latch, against the contact without control
_LAWS = {
    "least_squares": Law.SLOPE_THRESHOLD,
    "shifted_threshold": Law.SLOPE_THRESHOLD,
    "fade_out": Law.SLOPE_THRESHOLD,
    "precomputed": Law.PROFILE,
    "force_feedback": Law.FEEDBACK,
    "velocity_feedback": Law.FEEDBACK,
    "acceleration_feedback": Law.INTEGRAL_FEEDBACK,
}


def plant_spec(scene: Scene) -> PlantSpec:
    """Description of the plant. Raises SceneError if the scene asks for too many modes."""
    sphere, plate = _bodies(scene)
    table = scene.plate
    contact = _contact(scene, sphere, plate)
    infinite = plate_model(scene) == "infinite"
    limit = 0.5 / scene.step_s  # thesis2008: all modes to pi/dt
    if scene.run.scheme != "thesis2008":
        limit = frequency_limit_hz(
            sphere, plate, contact, scene.step_s, scene.run.accuracy,
            spring=scene.run.scheme == "modal",
        )  # fmt: skip
    modes = plate.modes_below(limit)
    if modes > _MAX_MODES:
        raise SceneError(
            f"plate.size_m = {list(table.size_m)} with plate.thickness_m = {table.thickness_m:g} "
            f"has about {modes:.2g} modes up to {limit:.3g} Hz, the most is {_MAX_MODES}; take a "
            f"smaller or thicker plate, or a larger run.accuracy (now {scene.run.accuracy:g})"
        )
    return PlantSpec(
        sphere=sphere,
        plate=plate,
        contact=contact,
        contact_point_m=table.contact_point_m,
        actuator_point_m=table.actuator_point_m or table.contact_point_m,
        step_s=scene.step_s,
        frequency_limit_hz=limit,
        lead_in_s=scene.run.lead_in_s,
        residual_flexibility=scene.run.scheme == "modal" and not infinite,
        infinite_plate=infinite,
    )


def _bodies(scene: Scene) -> tuple[Sphere, Plate]:
    ball, table = scene.sphere, scene.plate
    sphere = Sphere(MATERIALS[ball.material], ball.radius_m, ball.drop_height_m)
    plate = Plate(MATERIALS[table.material], table.size_m, table.thickness_m, table.loss_factor)
    return sphere, plate


def _contact(scene: Scene, sphere: Sphere, plate: Plate) -> Contact:
    stiffness = hertz_stiffness(sphere.radius_m, sphere.material, plate.material)
    table = scene.contact
    if table.damping == "viscous":
        return Contact(stiffness, Damping.VISCOUS, viscous_n_s_m=table.viscous_n_s_m)
    if table.damping == "hunt_crossley":
        d = hunt_crossley_parameter(table.restitution, sphere.impact_speed_m_s)
        return Contact(stiffness, Damping.HUNT_CROSSLEY, hunt_crossley_s_m=d)
    if table.damping == "relaxation":
        return Contact(
            stiffness,
            Damping.RELAXATION,
            relaxation_stiffness=table.relaxation_stiffness,
            relaxation_s=table.relaxation_s,
            extra_state=table.relaxation_solve == "bracketed",
        )
    return Contact(stiffness)


def plant_of(spec: PlantSpec, scene: Scene) -> Plant | ThesisPlant:
    """A plant by the scene's scheme. Raises ValueError for what that scheme does not know."""
    if scene.run.scheme == "thesis2008":
        return ThesisPlant(spec, scene.steps)
    return built(spec, scene.run.scheme).at_start()


def plant(scene: Scene) -> Plant | ThesisPlant:
    """The plant at the start of its run."""
    try:
        return plant_of(plant_spec(scene), scene)
    except ValueError as error:
        raise SceneError(str(error)) from error


@lru_cache(maxsize=8)
def built(spec: PlantSpec, scheme: str) -> Plant:
    """A plant whose model is shared by all runs of the same description."""
    if spec.infinite_plate:
        return InfinitePlant(spec)
    return CollocationPlant(spec) if scheme == "modal" else Plant(spec)


def model_error(scene: Scene) -> float:
    """Error of the penetration that leaving out modes, or the reflections, is expected to cost,
    relative."""
    spec = plant_spec(scene)
    if spec.infinite_plate:
        return infinite_plate_error(scene)
    return expected_error(
        spec.sphere, spec.plate, spec.contact, spec.frequency_limit_hz,
        spring=spec.residual_flexibility,
    )  # fmt: skip


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
    if until_s <= 0.0 or not _infinite_plate_possible(scene):
        return math.inf
    found = _reflections(scene)
    if not found.contact_s <= until_s:
        return math.inf
    return found.error(until_s, scene.step_s, _actuation(scene))


def infinite_plate_lasts_s(scene: Scene) -> float:
    """How long after the first touch an infinite plate meets the scene's accuracy, s; zero where
    it does not do so for a whole contact."""
    if not _infinite_plate_possible(scene):
        return 0.0
    found = _reflections(scene)
    lasts_s = found.lasts_s(scene.run.accuracy, scene.step_s, _actuation(scene))
    return lasts_s if lasts_s >= found.contact_s else 0.0


def first_touch_s(scene: Scene) -> float:
    """When the sphere first touches the plate, from the start of the run, to a step, s."""
    fall_s = _bodies(scene)[0].impact_speed_m_s / GRAVITY_M_S2
    return min(scene.run.lead_in_s, fall_s)


def _reflections(scene: Scene) -> Reflections:
    sphere, plate = _bodies(scene)
    return reflections(sphere, plate, _contact(scene, sphere, plate), scene.plate.contact_point_m)


def _infinite_plate_possible(scene: Scene) -> bool:
    """Whether the infinite plate can stand for the modes at all, by scheme, points and law: a
    force of more than the contact's own has no known limit."""
    point = scene.plate.actuator_point_m or scene.plate.contact_point_m
    control = scene.controller
    bounded = control.law in ("off", "constant", "profile") or abs(control.kappa) <= 1.0
    return scene.run.scheme == "modal" and point == scene.plate.contact_point_m and bounded


def _actuation(scene: Scene) -> Actuation:
    """What the actuator may do.

    A law that copies the contact force is as smooth as that, unless the line from sensor to
    actuator is not, with a delay of at most a contact, which it makes longer; any other counts
    as switched on and off at the largest force.
    """
    control, sensors = scene.controller, scene.sensors
    if control.law == "off":
        return Actuation()
    if control.law == "constant":
        return Actuation(jumps_n=2.0 * abs(control.force_n))
    if control.law == "profile":
        return Actuation(jumps_n=2.0 * max(map(abs, control.profile_n)))
    line_is_smooth = (
        sensors.bits == control.bits == "ideal"
        and sensors.every_steps == 1
        and sensors.noise_rms == control.jitter_us == control.lead_us == 0.0
        and control.drop_out_probability == 0.0
        and control.slew_n_s is None
    )
    if control.law == "slope_threshold" and line_is_smooth:
        delay_s = _LONGER * _reflections(scene).contact_s + 1e-6 * control.latency_us
        return Actuation(abs(control.kappa), delay_s)
    sphere, plate = _bodies(scene)
    stiffness = _contact(scene, sphere, plate).stiffness
    peak_n = rigid_peak_force_n(sphere.mass_kg, stiffness, sphere.impact_speed_m_s)
    return Actuation(jumps_n=2.0 * abs(control.kappa) * peak_n)


def full_scale(scene: Scene) -> tuple[float, float] | None:
    """Range of the converter in units of its quantity; None without limits.

    "auto" takes the largest value of a Hertz contact on a rigid plate as its measure: F, its
    penetration, F/Z of the plate's velocity, and pi/T times that of its acceleration.
    """
    table = scene.sensors
    if isinstance(table.full_scale, tuple):
        return table.full_scale
    if table.full_scale == "none" or table.bits == "ideal":
        return None
    spec = plant_spec(scene)
    m, v = spec.sphere.mass_kg, spec.sphere.impact_speed_m_s
    rigid = (1.25 * m * v * v / spec.contact.stiffness) ** 0.4
    if table.quantity == "xi":
        return _GAP_LOW * rigid, _GAP_HIGH * rigid
    force_n = spec.contact.stiffness * rigid**1.5
    if table.quantity == "contact_force":
        return 0.0, _ABOVE * force_n
    most = force_n / spec.plate.infinite_plate_impedance_n_s_m
    if table.quantity == "acceleration":
        most *= math.pi / rigid_contact_time_s(m, spec.contact.stiffness, v)
    return -_ABOVE * most, _ABOVE * most


def sensor(scene: Scene) -> Sensor:
    """The data-acquisition channel at the start of its run."""
    table = scene.sensors
    spec_ = SensorSpec(
        quantity=Quantity[table.quantity.upper()],
        every_steps=table.every_steps,
        low_pass_hz=table.low_pass_hz,
        full_scale=full_scale(scene),
        bits=None if table.bits == "ideal" else int(table.bits),
        noise_rms=table.noise_rms,
    )
    return Sensor(spec_, scene.step_s, scene.steps, scene.run.seed)


def controller(scene: Scene, stiffness: float) -> Controller:
    """The controller at the start of its run; `stiffness` in N/m^1.5 is the contact's."""
    table = scene.controller
    every = scene.sensors.every_steps

    def samples(time_us: float) -> int:
        return round(scene.in_steps(time_us) / every)

    profile: tuple[float, ...] = ()
    if table.law == "constant":
        profile = (table.force_n,) * samples(table.duration_us)
    elif table.law == "profile":
        profile = table.profile_n
    elif table.law == "precomputed":
        from hertzloop.precomputed import force_n  # it simulates, which needs these parts

        profile = force_n(scene)
    if profile:
        profile = (0.0,) * samples(table.delay_us) + profile
    law = replace(_law_spec(scene, stiffness), profile_n=profile)
    line = LineSpec(
        latency_steps=scene.in_steps(table.latency_us),
        jitter_steps=scene.in_steps(table.jitter_us),
        drop_out_probability=table.drop_out_probability,
        bits=None if table.bits == "ideal" else int(table.bits),
        full_scale_n=table.full_scale_n,
        slew_n_s=table.slew_n_s,
    )
    return Controller(law, line, scene.step_s, scene.steps, every, scene.run.seed)


def _law_spec(scene: Scene, stiffness: float) -> LawSpec:
    """The scene's law, without its profile."""
    table, every = scene.controller, scene.sensors.every_steps
    spec = LawSpec(
        law=_LAWS.get(table.law) or Law[table.law.upper()],
        stiffness=stiffness,
        kappa=table.kappa,
        v_thr_m_s=table.v_thr_m_s,
        lead_samples=round(scene.in_steps(table.lead_us) / every),
    )
    sphere, plate = _bodies(scene)
    impedance = plate.infinite_plate_impedance_n_s_m
    speed = sphere.impact_speed_m_s
    # The force of a sample acts one step after it at the earliest.
    horizon_s = (1 + scene.in_steps(table.latency_us)) * scene.step_s
    if table.law == "least_squares":
        return replace(spec, window=table.window_samples)
    if table.law == "fade_out":
        return replace(spec, fade_samples=round(scene.in_steps(table.fade_us) / every))
    if table.law == "shifted_threshold":
        v_thr = shifted_threshold_m_s(
            stiffness, sphere.mass_kg, impedance, speed, table.v_thr_m_s, horizon_s
        )
        return replace(spec, v_thr_m_s=v_thr)
    if table.law == "predicted":
        return replace(
            spec,
            window=table.window_samples,
            mass_kg=sphere.mass_kg,
            impedance_n_s_m=impedance,
            lead_samples=round(horizon_s / (every * scene.step_s)),
            watch_level=2.0 * speed * horizon_s,
        )
    if table.law in SENSED:
        gain = table.kappa if table.law == "force_feedback" else -table.kappa * impedance
        limits = full_scale(scene) if scene.sensors.bits != "ideal" else None
        # Zero need not be a level of the converter; the nearest one is half a step off at most.
        step = (limits[1] - limits[0]) / (2 ** int(scene.sensors.bits) - 1) if limits else 0.0
        return replace(spec, gain=gain, leak_hz=table.leak_hz, dead_zone=0.5000001 * step)
    return spec
