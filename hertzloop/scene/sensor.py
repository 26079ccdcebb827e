"""The data-acquisition channel of a run."""

from hertzloop.common.protocols import ExpectedImpact
from hertzloop.plant.contact.yielding import deepest_rigid_m
from hertzloop.scene.mechanics import Mechanics
from hertzloop.scene.quantities import SENSED
from hertzloop.scene.tables import SensorsTable
from hertzloop.sensors.acquisition import Fault, SensorSpec

_RESONANCE_DAMPING = 0.02  # of a bare force cell
_FAULTY = 0.01  # of samples, where a scene does not say how many
# A law that looks ahead, as `predicted`, watches from twice the flight in its horizon on.
_HORIZONS, _LEAST_FLIGHT_S = 2.5, 20e-6


def resolve_sensor(
    table: SensorsTable, mechanics: Mechanics, step_s: float, latency_us: float
) -> SensorSpec:
    """The channel; the signal path's `latency_us` counts for the flight that the range holds."""
    return SensorSpec(
        of_state=_index_of(table.quantity, mechanics),
        every_steps=table.every_steps,
        low_pass_hz=table.low_pass_hz,
        low_pass=table.low_pass,
        low_pass_order=table.low_pass_order,
        full_scale=_full_scale(table, mechanics, step_s, latency_us),
        bits=None if table.bits == "ideal" else int(table.bits),
        noise_rms=table.noise_rms,
        ac_coupling_hz=table.ac_coupling_hz,
        resonance_hz=table.resonance_hz,
        resonance_damping=(
            _RESONANCE_DAMPING if table.resonance_damping is None else table.resonance_damping
        ),
        fault=_fault_of(table, step_s),
    )


def _index_of(quantity: str, mechanics: Mechanics) -> int:
    """Index of a quantity in the state of the plant, where the sensor is."""
    elsewhere = SENSED[quantity].elsewhere
    if elsewhere is None or mechanics.sensor_point_m is None:
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
    table: SensorsTable, mechanics: Mechanics, step_s: float, latency_us: float
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
    contact = mechanics.contact
    m, v = mechanics.sphere.mass_kg, mechanics.sphere.impact_speed_m_s
    rigid, flight_s = mechanics.rigid, 0.0
    if table.full_scale == "auto":
        horizon_s = step_s + 1e-6 * latency_us
        flight_s = max(_HORIZONS * horizon_s, _LEAST_FLIGHT_S)
    force_n = rigid.peak_n
    return SENSED[table.quantity].range(
        ExpectedImpact(
            rigid_m=rigid.deepest_m,
            deepest_m=max(rigid.deepest_m, deepest_rigid_m(contact, 0.5 * m * v * v)),
            flight_m=v * flight_s,
            force_n=force_n,
            velocity_m_s=lambda: force_n / mechanics.local_plate.infinite_plate_impedance_n_s_m,
            contact_s=rigid.contact_s,
        )
    )
