"""The path of the force from the law to the actuator."""

import math

import numpy as np

from hertzloop.common.changed_fields import changed_fields
from hertzloop.controller.controller import SMOOTH_PATH_FIELDS, SignalPath
from hertzloop.scene.controller_table import ControllerTable
from hertzloop.scene.tables import ActuatorTable, RunTable
from hertzloop.sensors.acquisition import SMOOTH_FIELDS, SensorSpec


def resolve_signal_path(
    table: ControllerTable, actuator: ActuatorTable, every_steps: int, run: RunTable
) -> SignalPath:
    """The signal path from the law to the actuator."""
    steps = run.in_steps
    trace = np.rint(np.array(table.latency_trace or ()) * 1000 / run.step_ns).astype(int)
    least = int(trace.min()) if trace.size else steps(table.latency_us)
    stuck_s = actuator.stuck_from_s
    dead = steps(actuator.dead_time_us or 0.0)
    tick = every_steps / (1.0 + 1e-6 * table.clock_ppm)
    first_tick, drifts = table.clock_phase * tick, table.clock_ppm != 0.0
    if not drifts:  # every command waits for as long
        dead += math.floor(first_tick + 0.5)
    return SignalPath(
        trace=tuple((trace - least).tolist()),
        resampled=table.latency_trace_use == "resample",
        dead_steps=dead,
        stuck_step=None if stuck_s is None else steps(1e6 * stuck_s),
        latency_steps=least,
        jitter_steps=steps(table.jitter_us),
        drop_out_probability=table.drop_out_probability,
        bits=None if table.bits == "ideal" else int(table.bits),
        full_scale_n=table.full_scale_n,
        slew_n_s=table.slew_n_s,
        tick_steps=tick if drifts else 0.0,
        first_tick_steps=first_tick if drifts else 0.0,
    )


def keeps_force_smooth(sensor: SensorSpec, path: SignalPath) -> bool:
    """Whether sensor and signal path neither lose a command nor make steps in a law's force."""
    makes_steps = changed_fields(sensor, but=SMOOTH_FIELDS) + changed_fields(
        path, but=SMOOTH_PATH_FIELDS
    )
    return not makes_steps and not path.varies
