"""What must hold between the keys of a scene: one row a rule."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from hertzloop.common.readable import number
from hertzloop.plant.schemes.registry import SCHEMES, schemes_where
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.scene.errors import SceneError, shortened, shown
from hertzloop.scene.materials import material_name
from hertzloop.scene.quantities import SENSED
from hertzloop.scene.tables import (
    ActuatorTable,
    ModesTable,
    SensorsTable,
)

_EDGE = 1e-4  # of a side; nearer to it a point force moves no mode by more than rounding
_MOST_STEPS = 20_000_000
_NARROWEST = 1e-12  # range of a converter, in the unit of its quantity
_NARROWEST_SHARE = 1e-6  # of its larger number; 24 bits of it are still told apart


class Rule(NamedTuple):
    """A rule between keys: the key that breaks it, when a scene does so, and what to say then.

    `broken` returns None or False for a scene that keeps the rule; otherwise True, or a value that
    the sentence calls {x}; in a rule without a `key`, the key and such a value. So 0 and "" break
    it: compare (`> 0.0`) in place of returning a value of the scene as it is. The sentence comes
    after "key = value: " and may name the scene as {s}.
    """

    key: str
    broken: Callable[[Any], Any]
    says: str

    def problem(self, scene: Any, found: Any) -> str:
        """Return the sentence on a scene that breaks the rule; `found`: what `broken` returned."""
        key, found = (self.key, found) if self.key else found
        value, words = _value(scene, key), self.says.format(s=scene, x=found)
        return f"{key}: {words}" if value is None else f"{key} = {_shown(value)}: {words}"


def _value(scene: Any, key: str) -> Any:
    """The value of a key."""
    table, _, name = key.partition(".")
    return getattr(getattr(scene, table), name, None)


def _shown(value: object) -> str:
    if isinstance(value, float):
        return number(value)
    if isinstance(value, ModesTable):
        value = value.file
    return shown(list(value) if isinstance(value, tuple) else value)


def problem_of(scene: Any) -> str:
    """Return a sentence on the first rule that a scene breaks, "" if it keeps them all. Raises
    LawError."""
    for rule in RULES:
        found = rule.broken(scene)
        if found is not None and found is not False:
            return rule.problem(scene, found)
    return ""


def _fall_too_short(s: Any) -> float | None:
    """Time to the contact, s, where a run with a touch phase does not begin in flight."""
    fall_s, run = math.sqrt(2.0 * s.sphere.fall_m / GRAVITY_M_S2), s.run
    in_flight = run.step_s <= run.lead_in_s < fall_s - run.step_s
    return None if in_flight or run.touch_phase == _ORDINARY["run.touch_phase"][0] else fall_s


def _places(s: Any) -> Iterator[tuple[str, list[float]]]:
    """The points on a plate, in shares of its sides."""
    plate = s.plate
    if plate.modes is not None:
        return
    for key, point in (
        ("plate.contact_point_m", plate.contact_point_m),
        ("plate.actuator_point_m", plate.actuator_point_m),
        ("sensors.point_m", s.sensors.point_m),
    ):
        if point is not None:
            yield key, [x / side for x, side in zip(point, plate.size_m, strict=True)]


def _outside(s: Any) -> tuple[str, object] | None:
    for key, shares in _places(s):
        if not all(0.0 < share < 1.0 for share in shares):
            return key, list(s.plate.size_m)
    return None


def _on_edge(s: Any) -> tuple[str, object] | None:
    for key, shares in _places(s):
        edges = s.plate.edges or "ssss"
        for share, low, high in zip(shares, edges[::2], edges[1::2], strict=True):
            if (share < _EDGE and low != "f") or (share > 1.0 - _EDGE and high != "f"):
                return key, list(s.plate.size_m)
    return None


def _two_masses(s: Any) -> float | None:
    given = s.sphere.material
    return None if s.sphere.mass_kg is None or isinstance(given, str) else given.density_kg_m3


def _yields_unknown(s: Any) -> str | None:
    """The plate's material, if it has to yield and no number says where."""
    contact, material = s.contact, s.plant_tables.plate_material
    known = contact.limiting_pressure_pa or material.hardness_pa or material.yield_pa
    if contact.plasticity != "thornton" or known:
        return None
    name = shortened(material_name(s.plate.material))
    return f"plate.material = '{name}'" if name else "the plate's material"


# Values of keys that every scheme and every model of the plate can have.
_ORDINARY: dict[str, tuple[Any, ...]] = {
    "run.touch_phase": (0.5,),
    "contact.plasticity": ("none", "auto"),
    **{
        f"actuator.{key}": (field.default,)  # a later key is refused, too
        for key, field in ActuatorTable.model_fields.items()
        if key not in ("damping", "dead_time_us", "stuck_from_s")
    },
    "plate.tail": ("spring", "auto"),
    "sensors.point_m": (None,),
    "plate.modes": (None,),
    "plate.edges": (None, "ssss"),
    "plate.actuator_point_m": (None,),
    "contact.damping": (),
    "run.plate_model": ("auto", "modal"),
    "run.duration_s": (),
}
_ORDINARY_OF: list[Any] = [(*key.split("."), values) for key, values in _ORDINARY.items()]
# What needs no modes.
_OF_INFINITE_PLATE = (
    "run.plate_model",
    "run.touch_phase",
    "contact.damping",
    "plate.edges",
    "run.duration_s",
)


def _unsupported(s: Any) -> tuple[str, str] | None:
    """A key that the scheme refuses, or an infinite plate does not have, and why."""
    for table, name, ordinary in _ORDINARY_OF:
        value = getattr(getattr(s, table), name, None)
        if value in ordinary:
            continue
        key = f"{table}.{name}"
        if key == "plate.actuator_point_m" and value == s.plate.contact_point_m:
            continue
        asked = ("steps", s.run.steps) if key == "run.duration_s" else (key, value)
        if why := SCHEMES[s.run.scheme].refusal(*asked):
            others = schemes_where(lambda row: row.accepts(*asked))  # noqa: B023
            other = f", or use the scheme {others}" if others else ""
            return key, (
                f"run.scheme = '{s.run.scheme}', which {why}. Remove or change the key{other}."
            )
        if s.run.plate_model == "infinite" and key not in _OF_INFINITE_PLATE:
            return key, (
                "run.plate_model = 'infinite', which has no modes. Remove the key, or use "
                "run.plate_model = 'auto'."
            )
    return None


def check_conserves(scheme: str) -> None:
    """Raise SceneError for a scheme that keeps neither energy nor momentum, on which metrics of
    cases rest."""
    if not SCHEMES[scheme].conserves:
        raise SceneError(
            f"run.scheme = '{scheme}': not supported here. "
            f"Use {schemes_where(lambda row: row.conserves)}."
        )


def _uneven(s: Any) -> tuple[str, None] | None:
    """A key that is not a whole number of steps."""
    keys = [f"controller.{key}" for key in s.controller.whole_step_keys]
    for key in (*keys, "actuator.dead_time_us"):
        value = _value(s, key) or 0.0
        apart = abs(value * 1000 / s.run.step_ns - s.run.in_steps(value))
        if apart > 1e-9 * max(1.0, value):
            return key, None
    return None


def _acts_too_late(s: Any) -> bool:
    latency_us = s.controller.latency_us
    late = latency_us > 0.0 and s.run.in_steps(latency_us) + 1 >= s.run.steps
    return late and s.controller.has_law


def _waits_twice(s: Any) -> bool:
    control = s.controller
    has_clock = control.clock_ppm != 0.0 or control.clock_phase != 0.0
    from_tick = control.latency_trace_from == "tick"
    return has_clock and control.latency_trace is not None and not from_tick


# Keys that have an effect only beside another one, at a value of that one or, by None, at any.
BESIDE: dict[str, tuple[str, str | None]] = {
    "plate.residual_flexibility_m_n": ("plate.modes", None),
    "contact.viscous_n_s_m": ("contact.damping", "viscous"),
    "contact.restitution": ("contact.damping", "hunt_crossley"),
    **dict.fromkeys(
        ("contact.relaxation_stiffness", "contact.relaxation_s", "contact.relaxation_solve"),
        ("contact.damping", "relaxation"),
    ),
    "actuator.damping": ("actuator.bandwidth_hz", None),
    "controller.latency_trace_use": ("controller.latency_trace", None),
    "controller.latency_trace_from": ("controller.latency_trace", None),
    "sensors.low_pass": ("sensors.low_pass_hz", None),
    "sensors.low_pass_order": ("sensors.low_pass_hz", None),
    "sensors.resonance_damping": ("sensors.resonance_hz", None),
    **{
        f"sensors.{key}": ("sensors.fault", None)
        for key in SensorsTable.model_fields
        if key.startswith("fault_")
    },
}
# Keys that take the place of others, which have no effect then.
IN_PLACE = {
    "sphere.speed_m_s": ("sphere.drop_height_m",),
    "plate.modes": ("plate.loss_factor", "plate.edges", "plate.theory"),
}


def _given(s: Any, key: str) -> bool:
    """Whether a key has another value than its default."""
    table, _, name = key.partition(".")
    return bool(_value(s, key) != type(getattr(s, table)).model_fields[name].default)


def _idle(s: Any) -> tuple[str, str] | None:
    """A key that has no effect without another one, and that one."""
    for key, (other, wanted) in BESIDE.items():
        found = _value(s, other)
        if (found is None if wanted is None else found != wanted) and _given(s, key):
            return key, other if wanted is None else f"{other} = '{wanted}'"
    return None


def _replaced(s: Any) -> tuple[str, str] | None:
    """A key in whose place another one is given, and that one."""
    for key, others in IN_PLACE.items():
        for other in others:
            if _given(s, key) and _given(s, other):
                return other, key
    return None


def _missing(s: Any) -> tuple[str, str] | None:
    """A key that is missing, and one that may be given in its place."""
    if s.sphere.speed_m_s is None and s.sphere.drop_height_m is None:
        return "sphere.drop_height_m", "sphere.speed_m_s"
    for key in ("plate.size_m", "plate.thickness_m", "plate.contact_point_m"):
        if s.plate.modes is None and _value(s, key) is None:
            return key, "plate.modes"
    return None


def _senses(s: Any) -> list[str]:
    return [one.strip() for one in s.controller.loaded_law.senses.split(",")]


def _senses_unknown(s: Any) -> str | None:
    return None if {*_senses(s)} <= {*SENSED, "any"} else s.controller.loaded_law.senses


def _other_quantity(s: Any) -> str | None:
    if "any" in _senses(s) or s.sensors.quantity in _senses(s):
        return None
    return " or ".join(f"'{one}'" for one in _senses(s))


def _upside_down(s: Any) -> bool:
    limits = s.sensors.full_scale
    return isinstance(limits, tuple) and not limits[0] < limits[1]


def _narrow(s: Any) -> bool:
    limits = s.sensors.full_scale
    if not isinstance(limits, tuple):
        return False
    return limits[1] - limits[0] < max(_NARROWEST, _NARROWEST_SHARE * max(map(abs, limits)))


# The first that is broken is reported.
RULES = [
    Rule("", _missing, "is missing from the scene. Add it, or {x}."),
    Rule("", _replaced, "has no effect with {x}. Leave one of them out."),
    Rule("", _idle, "has no effect without {x}. Leave the key out, or set {x}."),
    Rule(
        "",
        _outside,
        "lies outside the plate. Give numbers above 0 and below plate.size_m = {x}.",
    ),
    Rule(
        "",
        _on_edge,
        f"lies on a supported edge. Keep a distance of {_EDGE:g} of plate.size_m = {{x}}.",
    ),
    Rule(
        "sphere.mass_kg",
        _two_masses,
        "sphere.material.density_kg_m3 = {x:g} gives the mass as well. Leave out sphere.mass_kg, "
        "or name the material.",
    ),
    Rule("", _unsupported, "not supported by {x}"),
    Rule(
        "contact.plasticity",
        _yields_unknown,
        "the yield pressure of {x} is unknown. Give plate.material.yield_pa, "
        "plate.material.hardness_pa or contact.limiting_pressure_pa, in Pa.",
    ),
    Rule(
        "contact.limiting_pressure_pa",
        lambda s: s.contact.limiting_pressure_pa is not None and s.contact.plasticity == "none",
        "has no effect with contact.plasticity = 'none'. Leave the key out, or set "
        "contact.plasticity = 'thornton'.",
    ),
    Rule(
        "plate.tail",
        lambda s: (
            s.plate.tail == "damped"
            and s.actuator.mass_kg is not None
            and len({*s.plate.points_m}) == 1
        ),
        "not supported with actuator.mass_kg = {s.actuator.mass_kg:g} at the contact point. Use "
        "'spring' or 'auto'.",
    ),
    Rule(
        "sensors.point_m",
        lambda s: s.sensors.point_m is not None and s.plate.modes is not None,
        "plate.modes of {s.plate.modes.file} know points by their columns only. Remove the key, "
        "and give the file a column shape_sensor.",
    ),
    Rule(
        "run.touch_phase",
        _fall_too_short,
        "the run must begin in flight. Set run.lead_in_s (now {s.run.lead_in_s:g}) to at least a "
        "step and less than the time to the contact, {x:.3g} s.",
    ),
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
