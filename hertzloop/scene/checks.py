"""Values of a scene that are possible alone, but not together."""

from functools import lru_cache

from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.scene.controller_table import ControllerTable
from hertzloop.scene.plant_checks import plant_problems
from hertzloop.scene.plant_tables import PlantTables
from hertzloop.scene.quantities import SENSED
from hertzloop.scene.tables import ActuatorTable, RunTable, SensorsTable

_MAX_STEPS = 20_000_000
_NARROWEST = 1e-12  # range of a converter, in the unit of its quantity
_NARROWEST_SHARE = 1e-6  # of its larger number; 24 bits of it are still told apart


def problems(
    plant: PlantTables, sensors: SensorsTable, control: ControllerTable, run: RunTable
) -> list[str]:
    """Sentences on values that are possible alone, but not together. Raises LawError."""
    of_plate, of_run = plant_problems(plant, run)
    return [
        *of_plate,
        *_line_problems(control, plant.actuator, run, control.whole_step_keys),
        *_quantity_problems(sensors, control),
        *of_run,
        *_converter_problems(sensors, control),
    ]


def _quantity_problems(sensors: SensorsTable, control: ControllerTable) -> list[str]:
    """Of what the sensor measures, how it is filtered and what goes wrong with it."""
    found = []
    quantity = SENSED[sensors.quantity]
    if sensors.point_m is not None and quantity.elsewhere is None:
        found.append(
            f"sensors.point_m = {list(sensors.point_m)}: sensors.quantity = "
            f"'{sensors.quantity}' is one of the contact. Remove the key, or use 'v_p' or "
            "'acceleration'."
        )
    shaped = sensors.low_pass != "butterworth" or sensors.low_pass_order > 1
    if sensors.low_pass_hz is None and shaped:
        found.append("sensors.low_pass_hz: is missing beside its kind or order. Give the corner")
    if sensors.resonance_damping is not None and sensors.resonance_hz is None:
        found.append(
            f"sensors.resonance_damping = {sensors.resonance_damping:g}: has no effect without "
            "sensors.resonance_hz. Give the natural frequency, or remove the key."
        )
    beside = [key for key, value in sensors if key.startswith("fault_") and value is not None]
    if sensors.fault is None and beside:
        found.append("sensors.fault: is missing beside other keys of a fault. Say which fault")
    if sensors.fault in ("offset", "spikes", "saturation") and sensors.fault_size is None:
        found.append(
            f"sensors.fault = '{sensors.fault}': needs sensors.fault_size, in the unit of "
            "sensors.quantity. Give a number"
        )
    law = control.loaded_law
    wanted = law.senses
    several = [one.strip() for one in wanted.split(",")]
    if not {*several} <= {*SENSED, "any"}:
        found.append(f"{law.name}: senses = '{wanted}' is unknown. Use any, {', '.join(SENSED)}.")
    elif "any" not in several and sensors.quantity not in several:
        accepted = " or ".join(f"'{one}'" for one in several)
        found.append(
            f"sensors.quantity = '{sensors.quantity}': controller.law = '{control.law}' needs "
            f"{accepted}. Use {accepted} or 'auto'."
        )
    return found


def _converter_problems(sensors: SensorsTable, control: ControllerTable) -> list[str]:
    """Of the ranges of both converters."""
    found = []
    if control.bits != "ideal" and control.full_scale_n is None:
        found.append(
            f"controller.bits = {control.bits}: needs the largest force. Give "
            "controller.full_scale_n in N."
        )
    limits = sensors.full_scale
    if isinstance(limits, tuple):
        if not limits[0] < limits[1]:
            found.append(
                f"sensors.full_scale = {list(limits)}: the first number must be the lower one. "
                "Swap or change them."
            )
        elif limits[1] - limits[0] < max(_NARROWEST, _NARROWEST_SHARE * max(map(abs, limits))):
            found.append(
                f"sensors.full_scale = {list(limits)}: the range is too narrow. Use at least "
                f"{_NARROWEST:g}, and {_NARROWEST_SHARE:g} of the larger number."
            )
    if sensors.bits != "ideal" and limits == "none":
        found.append(
            f"sensors.bits = {sensors.bits}: needs a range. Set sensors.full_scale, not 'none'."
        )
    return found


@lru_cache(maxsize=64)
def _line_problems(
    control: ControllerTable,
    actuator: ActuatorTable,
    run: RunTable,
    whole_step_keys: tuple[str, ...],
) -> list[str]:
    """Of the length of the run, and of the line from law to actuator in it."""
    found, steps, in_steps = [], run.steps, run.in_steps
    if not 1 <= steps <= _MAX_STEPS:
        found.append(
            f"run.duration_s = {run.duration_s:g} gives {steps} steps of run.step_ns = "
            f"{run.step_ns}. A run has 1 to {_MAX_STEPS} steps; change one of the two."
        )
    times_us = {f"controller.{key}": getattr(control, key) for key in whole_step_keys}
    for key, value in (times_us | {"actuator.dead_time_us": actuator.dead_time_us or 0.0}).items():
        if abs(value * 1000 / run.step_ns - in_steps(value)) > 1e-9 * max(1.0, value):
            found.append(
                f"{key} = {value:g}: must be a whole number of steps. Give a multiple "
                f"of {run.step_ns / 1000:g} us (run.step_ns = {run.step_ns})."
            )
    late = control.latency_us > 0.0 and in_steps(control.latency_us) + 1 >= steps
    if control.law != NO_CONTROL and late:
        found.append(
            f"controller.latency_us = {control.latency_us:g}: is as long as the run, so no force "
            f"acts. Reduce it or increase run.duration_s (now {run.duration_s:g})."
        )
    if control.latency_trace is not None and control.latency_us != 0.0:
        found.append(
            f"controller.latency_us = {control.latency_us:g}: has no effect beside "
            "controller.latency_trace. Leave one of them out"
        )
    if control.latency_trace == ():
        found.append("controller.latency_trace = []: is empty. Give at least one latency, us.")
    for key in ("latency_trace_use", "latency_trace_from"):
        value = getattr(control, key)
        if value is not None and control.latency_trace is None:
            found.append(
                f"controller.{key} = '{value}': has no effect without controller.latency_trace. "
                "Give a trace, or remove the key."
            )
    has_clock = control.clock_ppm != 0.0 or control.clock_phase != 0.0
    if has_clock and control.latency_trace is not None and control.latency_trace_from != "tick":
        found.append(
            "controller.latency_trace: the wait for controller.clock_ppm and clock_phase must not "
            "count twice. If the trace begins at the sample, it contains the wait: leave out both "
            "keys. If it begins at the clock's tick, set controller.latency_trace_from = 'tick'"
        )
    return found
