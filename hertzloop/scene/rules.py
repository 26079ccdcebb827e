"""What must hold between the keys of a scene: one row a rule."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from hertzloop.common.readable import number
from hertzloop.scene.errors import shown
from hertzloop.scene.quantities import SENSED

if TYPE_CHECKING:
    from hertzloop.scene.scene import Scene

_MOST_STEPS = 20_000_000
_NARROWEST = 1e-12  # range of a converter, in the unit of its quantity
_NARROWEST_SHARE = 1e-6  # of its larger number; 24 bits of it are still told apart


class Rule(NamedTuple):
    """A rule between keys: the key that breaks it, when a scene does so, and what to say then.

    `broken` returns None or False for a scene that keeps the rule; otherwise True, a value that the
    sentence calls {x}, or, in a rule without a `key`, the key. The sentence follows "key = value: "
    and may name the scene as {s}.
    """

    key: str
    broken: Callable[["Scene"], Any]
    says: str

    def problem(self, scene: "Scene") -> str:
        """Return the sentence on a scene that breaks the rule, "" for another."""
        found = self.broken(scene)
        if found is None or found is False:
            return ""
        key = self.key or found
        value: Any = scene
        for part in key.split("."):
            value = getattr(value, part)
        words = self.says.format(s=scene, x=found)
        return f"{key}: {words}" if value is None else f"{key} = {_shown(value)}: {words}"


def _shown(value: object) -> str:
    if isinstance(value, float):
        return number(value)
    return shown(list(value) if isinstance(value, tuple) else value)


def problem_of(scene: "Scene") -> str:
    """Return a sentence on the first rule that a scene breaks, "" if it keeps them all. Raises
    LawError."""
    return next(filter(None, (rule.problem(scene) for rule in RULES)), "")


def _uneven(s: "Scene") -> str | None:
    """A key that is not a whole number of steps."""
    keys = [f"controller.{key}" for key in s.controller.whole_step_keys]
    for key in (*keys, "actuator.dead_time_us"):
        table, _, name = key.partition(".")
        value = getattr(getattr(s, table), name) or 0.0
        if abs(value * 1000 / s.run.step_ns - s.run.in_steps(value)) > 1e-9 * max(1.0, value):
            return key
    return None


def _acts_too_late(s: "Scene") -> bool:
    latency_us = s.controller.latency_us
    late = latency_us > 0.0 and s.run.in_steps(latency_us) + 1 >= s.run.steps
    return late and s.controller.has_law


def _waits_twice(s: "Scene") -> bool:
    control = s.controller
    has_clock = control.clock_ppm != 0.0 or control.clock_phase != 0.0
    from_tick = control.latency_trace_from == "tick"
    return has_clock and control.latency_trace is not None and not from_tick


def _without_fault(s: "Scene") -> bool:
    beside = (value for key, value in s.sensors if key.startswith("fault_"))
    return s.sensors.fault is None and any(value is not None for value in beside)


def _senses(s: "Scene") -> list[str]:
    return [one.strip() for one in s.controller.loaded_law.senses.split(",")]


def _senses_unknown(s: "Scene") -> str | None:
    return None if {*_senses(s)} <= {*SENSED, "any"} else s.controller.loaded_law.senses


def _other_quantity(s: "Scene") -> str | None:
    if "any" in _senses(s) or s.sensors.quantity in _senses(s):
        return None
    return " or ".join(f"'{one}'" for one in _senses(s))


def _upside_down(s: "Scene") -> bool:
    limits = s.sensors.full_scale
    return isinstance(limits, tuple) and not limits[0] < limits[1]


def _narrow(s: "Scene") -> bool:
    limits = s.sensors.full_scale
    if not isinstance(limits, tuple):
        return False
    return limits[1] - limits[0] < max(_NARROWEST, _NARROWEST_SHARE * max(map(abs, limits)))


# The first that is broken is reported.
RULES = [
    Rule(
        "run.duration_s",
        lambda s: s.run.steps if not 1 <= s.run.steps <= _MOST_STEPS else None,
        "gives {x} steps of run.step_ns = {s.run.step_ns}. A run has 1 to "
        f"{_MOST_STEPS} steps; change one of the two.",
    ),
    Rule(
        "",
        _uneven,
        "must be a whole number of steps. Give a multiple of {s.run.step_us:g} us (run.step_ns = "
        "{s.run.step_ns}).",
    ),
    Rule(
        "controller.latency_us",
        _acts_too_late,
        "is as long as the run, so no force acts. Reduce it or increase run.duration_s (now "
        "{s.run.duration_s:g}).",
    ),
    Rule(
        "controller.latency_us",
        lambda s: s.controller.latency_us != 0.0 and s.controller.latency_trace is not None,
        "has no effect beside controller.latency_trace. Leave one of them out.",
    ),
    Rule(
        "controller.latency_trace",
        lambda s: s.controller.latency_trace == (),
        "is empty. Give at least one latency, us.",
    ),
    *(
        Rule(
            f"controller.{key}",
            lambda s, key=key: getattr(s.controller, key) and s.controller.latency_trace is None,
            "has no effect without controller.latency_trace. Give a trace, or remove the key.",
        )
        for key in ("latency_trace_use", "latency_trace_from")
    ),
    Rule(
        "controller.latency_trace",
        _waits_twice,
        "the wait for controller.clock_ppm and clock_phase must not count twice. If the trace "
        "begins at the sample, it contains the wait: leave out both keys. If it begins at the "
        "clock's tick, set controller.latency_trace_from = 'tick'.",
    ),
    Rule(
        "sensors.point_m",
        lambda s: s.sensors.point_m is not None and SENSED[s.sensors.quantity].elsewhere is None,
        "sensors.quantity = '{s.sensors.quantity}' is one of the contact. Remove the key, or use "
        "'v_p' or 'acceleration'.",
    ),
    Rule(
        "sensors.low_pass_hz",
        lambda s: (
            s.sensors.low_pass_hz is None
            and (s.sensors.low_pass != "butterworth" or s.sensors.low_pass_order > 1)
        ),
        "is missing beside the kind or order of the low-pass. Give its cut-off frequency.",
    ),
    Rule(
        "sensors.resonance_damping",
        lambda s: s.sensors.resonance_damping is not None and s.sensors.resonance_hz is None,
        "has no effect without sensors.resonance_hz. Give the natural frequency, or remove the "
        "key.",
    ),
    Rule(
        "sensors.fault",
        _without_fault,
        "is missing beside other keys of a fault. Say which fault.",
    ),
    Rule(
        "sensors.fault",
        lambda s: (
            s.sensors.fault in ("offset", "spikes", "saturation") and s.sensors.fault_size is None
        ),
        "needs sensors.fault_size, in the unit of sensors.quantity. Give a number.",
    ),
    Rule(
        "controller.law",
        _senses_unknown,
        f"its senses = '{{x}}' is unknown. Use any, {', '.join(SENSED)}.",
    ),
    Rule(
        "sensors.quantity",
        _other_quantity,
        "controller.law = '{s.controller.law}' needs {x}. Use {x} or 'auto'.",
    ),
    Rule(
        "controller.bits",
        lambda s: s.controller.bits != "ideal" and s.controller.full_scale_n is None,
        "needs the largest force. Give controller.full_scale_n in N.",
    ),
    Rule(
        "sensors.full_scale",
        _upside_down,
        "the first number must be the lower one. Swap or change them.",
    ),
    Rule(
        "sensors.full_scale",
        _narrow,
        f"the range is too narrow. Use at least {_NARROWEST:g}, and {_NARROWEST_SHARE:g} of the "
        "larger number.",
    ),
    Rule(
        "sensors.bits",
        lambda s: s.sensors.bits != "ideal" and s.sensors.full_scale == "none",
        "needs a range. Set sensors.full_scale, not 'none'.",
    ),
]
