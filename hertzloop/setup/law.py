"""Stages 3, 6 and 7: the law's reach, sensor and line, the law with its constants."""

import math
from dataclasses import replace
from functools import lru_cache

from hertzloop.controller.controller import LineSpec
from hertzloop.controller.law import About, Reach
from hertzloop.controller.loading.law import Law, LawError
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.plant.contact.yielding import deepest_rigid_m, yield_depth_m
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.quantities import SENSED, Expected
from hertzloop.scenes.scene import ControllerTable
from hertzloop.scenes.tables import ActuatorTable, SensorsTable
from hertzloop.sensors.acquisition import Fault, SensorSpec
from hertzloop.setup.bodies import KEPT, Bodies
from hertzloop.setup.plate import Smoothness

# A law that looks ahead, as `predicted`, watches from twice the flight in its horizon on.
_RESONANCE_DAMPING = 0.02  # of a bare force cell
_FAULTY = 0.01  # of samples, where a scene does not say how many
_HORIZONS, _LEAST_FLIGHT_S = 2.5, 20e-6


@lru_cache(maxsize=KEPT)
def sensor_of(table: SensorsTable, bodies: Bodies, step_s: float, latency_us: float) -> SensorSpec:
    """The channel; `latency_us` of the line counts for the flight that the range has to hold."""
    return SensorSpec(
        of_state=_index_of(table.quantity, bodies),
        every_steps=table.every_steps,
        low_pass_hz=table.low_pass_hz,
        full_scale=_full_scale(table, bodies, step_s, latency_us),
        bits=None if table.bits == "ideal" else int(table.bits),
        noise_rms=table.noise_rms,
        ac_coupling_hz=table.ac_coupling_hz,
        resonance_hz=table.resonance_hz,
        resonance_damping=(
            _RESONANCE_DAMPING if table.resonance_damping is None else table.resonance_damping
        ),
        fault=_fault_of(table, step_s),
    )


def _index_of(quantity: str, bodies: Bodies) -> int:
    """Index of a quantity in the state of the plant, where the sensor is."""
    elsewhere = SENSED[quantity].elsewhere
    if elsewhere is None or bodies.sensor_point_m is None:
        return SENSED[quantity].of_state
    return elsewhere


def _fault_of(table: SensorsTable, step_s: float) -> Fault | None:
    """The fault of a sensor, in samples; None of a sensor without one."""
    if table.fault is None:
        return None
    sample_s, lasts_s = step_s * table.every_steps, table.fault_duration_s
    lasts = None if lasts_s is None else max(1, round(lasts_s / sample_s))
    return Fault(
        kind=table.fault,
        start=round((table.fault_start_s or 0.0) / sample_s),
        lasts=lasts,
        size=table.fault_size or 0.0,
        probability=table.fault_probability or _FAULTY,
    )


def _full_scale(
    table: SensorsTable, bodies: Bodies, step_s: float, latency_us: float
) -> tuple[float, float] | None:
    """Range of the converter in units of its quantity; None without limits.

    "contact" takes the largest value of the contact on a rigid plate as its measure: F, its
    penetration (deeper where it yields), F/Z of the plate's velocity, and pi/T times that of its
    acceleration. "auto" is the same with the flight above the plate that a law has to see: that
    of the horizon with a window, and of 20 us at least.
    """
    if isinstance(table.full_scale, tuple):
        return table.full_scale
    if table.full_scale == "none" or table.bits == "ideal":
        return None
    contact = bodies.contact
    m, v = bodies.sphere.mass_kg, bodies.sphere.impact_speed_m_s
    rigid, flight_s = rigid_impact(bodies.sphere, contact), 0.0
    if table.full_scale == "auto":
        horizon_s = step_s + 1e-6 * latency_us
        flight_s = max(_HORIZONS * horizon_s, _LEAST_FLIGHT_S)
    force_n = rigid.peak_n
    return SENSED[table.quantity].range(
        Expected(
            rigid_m=rigid.deepest_m,
            deepest_m=max(rigid.deepest_m, deepest_rigid_m(contact, 0.5 * m * v * v)),
            flight_m=v * flight_s,
            force_n=force_n,
            velocity_m_s=lambda: force_n / bodies.local_plate.infinite_plate_impedance_n_s_m,
            contact_s=rigid.contact_s,
        )
    )


def models_yield(table: ControllerTable) -> bool:
    """Whether the law declares that it allows for a permanent dent; false if it is missing."""
    try:
        return table.found.models_yield
    except LawError:
        return False


def reach_of(table: ControllerTable) -> Reach:
    """How far the force of the law can go; without limit if the law is not there any more, as that
    of a recording may be. Raises SceneError."""
    try:
        law = table.found
    except LawError:
        return Reach()
    return _reach_of(table, law)


@lru_cache(maxsize=KEPT)
def _reach_of(table: ControllerTable, law: Law) -> Reach:
    try:
        return law.reach(table.keys)
    except LawError as error:
        raise SceneError(str(error)) from error


@lru_cache(maxsize=KEPT)
def about_impact(bodies: Bodies, s: float) -> About:
    """What a law may know of the bodies alone, with the contact stiffness `s`, N/m^exponent."""
    m, v = bodies.sphere.mass_kg, bodies.sphere.impact_speed_m_s
    local = bodies.structure.local_plate
    rigid = rigid_impact(bodies.sphere, replace(bodies.contact, stiffness=s))
    return About(
        stiffness=s,
        exponent=bodies.contact.exponent,
        sphere_mass_kg=m,
        impact_speed_m_s=v,
        impedance_n_s_m=local.infinite_plate_impedance_n_s_m if local else math.nan,
        rigid_contact_s=rigid.contact_s,
        rigid_peak_n=rigid.peak_n,
        yield_depth_m=yield_depth_m(bodies.contact),
    )


@lru_cache(maxsize=KEPT)
def about_bodies(
    bodies: Bodies, stiffness: float, line: LineSpec, step_ns: int, every_steps: int
) -> About:
    """What a law may know without a simulation and without the range of the converter."""
    limit_n = line.full_scale_n
    return replace(
        about_impact(bodies, stiffness),
        step_ns=step_ns,
        every_steps=every_steps,
        # The force of a sample acts one step after it at the earliest.
        horizon_steps=1 + line.latency_steps,
        limit_n=math.inf if limit_n is None else limit_n,
    )


@lru_cache(maxsize=KEPT)
def smoothness_of(
    control: ControllerTable, sensors: SensorsTable, line: LineSpec, latency_us: float
) -> Smoothness:
    """What sensor and line do to the smoothness of a law's force."""
    return Smoothness(
        smooth=sensors.bits == control.bits == "ideal"
        and sensors.every_steps == 1
        and sensors.noise_rms == control.jitter_us == 0.0
        and sensors.fault is None
        and line.most_added_steps == line.dead_steps
        and line.stuck_step is None
        and control.drop_out_probability == 0.0
        and control.slew_n_s is None,
        latency_s=1e-6 * latency_us,
    )


@lru_cache(maxsize=KEPT)
def line_of(table: ControllerTable, actuator: ActuatorTable, step_ns: int) -> LineSpec:
    """The line from the law to the actuator."""

    def steps(time_us: float) -> int:
        return round(time_us * 1000 / step_ns)

    least, stuck_s = steps(table.least_latency_us), actuator.stuck_from_s
    return LineSpec(
        trace=tuple(steps(time_us) - least for time_us in table.latency_trace or ()),
        resampled=table.latency_trace_use == "resample",
        dead_steps=steps(actuator.dead_time_us or 0.0),
        stuck_step=None if stuck_s is None else steps(1e6 * stuck_s),
        latency_steps=least,
        jitter_steps=round(table.jitter_us * 1000 / step_ns),
        drop_out_probability=table.drop_out_probability,
        bits=None if table.bits == "ideal" else int(table.bits),
        full_scale_n=table.full_scale_n,
        slew_n_s=table.slew_n_s,
    )
