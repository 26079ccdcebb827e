"""Sixth stage: the data-acquisition channel and the range of its converter."""

from functools import lru_cache

from hertzloop.scenes.quantities import SENSED, Expected
from hertzloop.scenes.tables import SensorsTable
from hertzloop.setup.bodies import KEPT, Bodies
from plant.contact.hertz import rigid_contact_time_s, rigid_penetration_m
from plant.contact.yielding import deepest_rigid_m
from sensors.acquisition import SensorSpec

# A law that looks ahead, as `predicted`, watches from twice the flight in its horizon on.
_HORIZONS, _LEAST_FLIGHT_S = 2.5, 20e-6


@lru_cache(maxsize=KEPT)
def sensor_of(table: SensorsTable, bodies: Bodies, step_s: float, latency_us: float) -> SensorSpec:
    """The channel; `latency_us` of the line counts for the flight that the range has to hold."""
    return SensorSpec(
        of_state=SENSED[table.quantity].of_state,
        every_steps=table.every_steps,
        low_pass_hz=table.low_pass_hz,
        full_scale=_full_scale(table, bodies, step_s, latency_us),
        bits=None if table.bits == "ideal" else int(table.bits),
        noise_rms=table.noise_rms,
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
    rigid, flight_s = rigid_penetration_m(m, contact.stiffness, v), 0.0
    if table.full_scale == "auto":
        horizon_s = step_s + 1e-6 * latency_us
        flight_s = max(_HORIZONS * horizon_s, _LEAST_FLIGHT_S)
    force_n = contact.stiffness * rigid**1.5
    return SENSED[table.quantity].range(
        Expected(
            rigid_m=rigid,
            deepest_m=max(rigid, deepest_rigid_m(contact, 0.5 * m * v * v)),
            flight_m=v * flight_s,
            force_n=force_n,
            velocity_m_s=lambda: force_n / bodies.local_plate.infinite_plate_impedance_n_s_m,
            contact_s=rigid_contact_time_s(m, contact.stiffness, v),
        )
    )
