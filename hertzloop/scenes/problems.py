"""What values of a scene do not fit together, each alone being fine."""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from hertzloop.controller.loading.registry import controls
from hertzloop.plant.contact.hertz import GRAVITY_M_S2, HERTZ
from hertzloop.plant.schemes.registry import SCHEMES, supporting
from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.plant.structures.registry import STRUCTURES
from hertzloop.scenes.errors import shortened, shown
from hertzloop.scenes.materials import MaterialTable, material_called
from hertzloop.scenes.quantities import SENSED

if TYPE_CHECKING:
    from hertzloop.controller.loading.law import Law
    from hertzloop.scenes.controller_table import ControllerTable
    from hertzloop.scenes.tables import (
        ActuatorTable,
        ContactTable,
        HammerTable,
        PlateTable,
        RunTable,
        SensorsTable,
        SphereTable,
        Striker,
    )

_MAX_STEPS = 20_000_000
_EDGE = 1e-4  # of a side; nearer to it a point force moves no mode by more than rounding
_MIDDLE = 0.5  # touch phase of a run that says nothing else
_NARROWEST = 1e-12  # range of a converter, in the unit of its quantity
_NARROWEST_SHARE = 1e-6  # of its larger number; 24 bits of it are still told apart


class _Uncontrolled(NamedTuple):
    """The tables of a scene that are neither sensor nor controller."""

    sphere: "SphereTable | None"
    hammer: "HammerTable | None"
    plate: "PlateTable"
    contact: "ContactTable"
    actuator: "ActuatorTable"
    materials: tuple[MaterialTable, ...] | None
    run: "RunTable"


class SceneTables(Protocol):
    """A scene, as far as its problems go."""

    materials: tuple[MaterialTable, ...] | None
    sphere: "SphereTable | None"
    hammer: "HammerTable | None"
    plate: "PlateTable"
    contact: "ContactTable"
    sensors: "SensorsTable"
    controller: "ControllerTable"
    actuator: "ActuatorTable"
    run: "RunTable"

    @property
    def law(self) -> "Law":
        """The law. Raises SceneError."""

    def whole_step_keys(self) -> list[str]:
        """Return keys of the controller that have to be a whole number of steps."""


def problems(scene: SceneTables) -> list[str]:
    """Sentences on values that are fine alone, but not together."""
    found = []
    run, control = scene.run, scene.controller
    tables = _Uncontrolled(
        scene.sphere, scene.hammer, scene.plate, scene.contact, scene.actuator, scene.materials, run
    )
    of_plate, of_run = _beside_control(tables)
    found += of_plate
    found += _line_problems(control, scene.actuator, run, tuple(scene.whole_step_keys()))
    sensors = scene.sensors
    if sensors.fault is None and sensors.has_fault_keys:
        found.append("sensors.fault: is missing beside other keys of a fault. Say which fault")
    if sensors.fault in ("offset", "spikes", "saturation") and sensors.fault_size is None:
        found.append(
            f"sensors.fault = '{sensors.fault}': needs sensors.fault_size, in the unit of "
            "sensors.quantity. Give a number"
        )
    wanted = scene.law.senses
    several = [one.strip() for one in wanted.split(",")]
    if not {*several} <= {*SENSED, "any"}:
        found.append(
            f"{scene.law.name}: senses = '{wanted}' is unknown. Use any, {', '.join(SENSED)}."
        )
    elif "any" not in several and scene.sensors.quantity not in several:
        found.append(
            f"sensors.quantity = '{scene.sensors.quantity}': controller.law = '{control.law}' "
            f"needs '{wanted}'. Use '{wanted}' or 'auto'."
        )
    found += of_run
    if control.bits != "ideal" and control.full_scale_n is None:
        found.append(
            f"controller.bits = {control.bits}: needs the largest force. Give "
            "controller.full_scale_n in N."
        )
    limits = scene.sensors.full_scale
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
    if scene.sensors.bits != "ideal" and limits == "none":
        found.append(
            f"sensors.bits = {scene.sensors.bits}: needs a range. Set sensors.full_scale, not "
            "'none'."
        )
    return found


@lru_cache(maxsize=64)
def _line_problems(
    control: "ControllerTable", actuator: "ActuatorTable", run: "RunTable",
    whole_step_keys: tuple[str, ...],
) -> list[str]:  # fmt: skip
    """Of the length of the run, and of the line from law to actuator in it."""
    found, steps, in_steps = [], run.steps, run.in_steps
    if not 1 <= steps <= _MAX_STEPS:
        found.append(
            f"run.duration_s = {run.duration_s:g} gives {steps} steps of run.step_ns = "
            f"{run.step_ns}. A run has 1 to {_MAX_STEPS} steps; change one of the two."
        )
    for key in whole_step_keys:
        value = getattr(control, key)
        if abs(value * 1000 / run.step_ns - in_steps(value)) > 1e-9 * max(1.0, value):
            found.append(
                f"controller.{key} = {value:g}: must be a whole number of steps. Give a multiple "
                f"of {run.step_ns / 1000:g} us (run.step_ns = {run.step_ns})."
            )
    late = control.latency_us > 0.0 and in_steps(control.latency_us) + 1 >= steps
    if controls(control.law) and late:
        found.append(
            f"controller.latency_us = {control.latency_us:g}: is as long as the run, so no force "
            f"acts. Reduce it or increase run.duration_s (now {run.duration_s:g})."
        )
    if control.latency_trace is not None and control.latency_us != 0.0:
        found.append(
            f"controller.latency_us = {control.latency_us:g}: has no effect beside "
            "controller.latency_trace. Leave one of them out"
        )
    dead_us = actuator.dead_time_us or 0.0
    if abs(dead_us * 1000 / run.step_ns - in_steps(dead_us)) > 1e-9 * max(1.0, dead_us):
        found.append(
            f"actuator.dead_time_us = {dead_us:g}: must be a whole number of steps. Give a "
            f"multiple of {run.step_ns / 1000:g} us"
        )
    return found


@lru_cache(maxsize=64)
def _beside_control(scene: _Uncontrolled) -> tuple[list[str], list[str]]:
    """Of the plate alone, and of the run with all that is neither sensor nor controller."""
    of_plate = _structure_problems(scene) + _point_problems(scene.plate)
    of_striker = _striker_problems(scene)
    if of_striker:  # what else there is may follow from it
        return of_striker, []
    return of_plate, _phase_problems(scene) + _scheme_problems(scene) + unread(scene)


def _striker_problems(scene: _Uncontrolled) -> list[str]:
    """What a scene says of the sphere or the hammer that does not make one striker."""
    sphere, hammer = scene.sphere, scene.hammer
    if (sphere is None) == (hammer is None):
        said = "no table" if sphere is None else "two tables"
        return [f"[sphere] and [hammer]: {said} of what strikes the plate. Give one of the two."]
    striker = sphere or hammer
    assert striker is not None
    if material_called(striker.material, scene.materials or ()).orthotropic:
        key = "sphere.material" if sphere is not None else "hammer.tip_material"
        return [f"{key}: is orthotropic, which a plate alone can be. Use an isotropic material."]
    if sphere is not None:
        both = sphere.drop_height_m is not None and sphere.speed_m_s is not None
        if both:
            return [
                f"sphere.drop_height_m = {sphere.drop_height_m:g} and sphere.speed_m_s = "
                f"{sphere.speed_m_s:g}: both give the impact speed. Leave one out."
            ]
        if sphere.drop_height_m is sphere.speed_m_s is None:
            return ["sphere.drop_height_m: is missing from the scene. Add it, or sphere.speed_m_s."]
        given = sphere.material
        if sphere.mass_kg is not None and not isinstance(given, str):
            return [
                f"sphere.mass_kg = {sphere.mass_kg:g} and sphere.material.density_kg_m3 = "
                f"{given.density_kg_m3:g}: both give the mass. Leave out sphere.mass_kg, or name "
                "the material."
            ]
        return []
    assert hammer is not None
    radius, stiffness, exponent = hammer.tip_radius_m, hammer.tip_stiffness, hammer.tip_exponent
    if radius is not None and stiffness is not None:
        return [
            f"hammer.tip_radius_m = {radius:g} and hammer.tip_stiffness = {stiffness:g}: both "
            "give the contact force. Leave one out."
        ]
    if (stiffness is None) != (exponent is None):
        return [
            "hammer.tip_stiffness and hammer.tip_exponent: one says nothing without the other, "
            "because the unit of the stiffness is N/m^exponent. Give both, or hammer.tip_radius_m."
        ]
    if radius is stiffness is None:
        return [
            "hammer.tip_radius_m: is missing from the scene. Add it, or hammer.tip_stiffness and "
            "hammer.tip_exponent."
        ]
    return _hammer_problems(scene, hammer)


def _hammer_problems(scene: _Uncontrolled, hammer: "HammerTable") -> list[str]:
    """What does not go with a hammer."""
    stiffness, exponent = hammer.tip_stiffness, hammer.tip_exponent
    found = _needs("supports_hammer", scene.run.scheme, "modal", "[hammer]")
    if exponent not in (None, HERTZ):
        found += _needs(
            "supports_exponent", scene.run.scheme, "modal", f"hammer.tip_exponent = {exponent:g}"
        )
    if stiffness is not None and scene.contact.plasticity != "none":
        found.append(
            f"contact.plasticity = '{scene.contact.plasticity}': needs the radius of the tip, "
            f"which hammer.tip_stiffness = {stiffness:g} does not give. Give hammer.tip_radius_m."
        )
    return found


def _phase_problems(scene: _Uncontrolled) -> list[str]:
    """A touch phase of a run that does not begin in flight, or counts whole steps only."""
    run = scene.run
    if run.touch_phase == _MIDDLE:
        return []
    phase = f"run.touch_phase = {run.touch_phase!r}"
    fall_s = math.inf
    if scene.sphere is not None:
        body = scene.sphere.striker(MATERIALS["steel"])
        fall_s = math.sqrt(2.0 * body.drop_height_m / GRAVITY_M_S2)
    if not SCHEMES[run.scheme].supports_touch_phase:
        return [
            f"{phase}: not supported by run.scheme = '{run.scheme}'. Remove the key, or use the "
            f"scheme {supporting('supports_touch_phase')}."
        ]
    if not run.step_s <= run.lead_in_s < fall_s - run.step_s:
        return [
            f"{phase}: the run must begin in flight. Set run.lead_in_s (now {run.lead_in_s:g}) to "
            f"at least a step and less than the fall time, {fall_s:.3g} s."
        ]
    return []


def _point_problems(plate: "PlateTable") -> list[str]:
    """Points beyond the plate, or where it is held."""
    found: list[str] = []
    if plate.modes is not None or plate.size_m is None:
        return found
    edges = plate.edges or "ssss"
    for key in ("contact_point_m", "actuator_point_m"):
        point = getattr(plate, key)
        if point is None:
            continue
        shares = [p / size for p, size in zip(point, plate.size_m, strict=True)]
        if not all(0 < p < size for p, size in zip(point, plate.size_m, strict=True)):
            found.append(
                f"plate.{key} = {list(point)} lies outside the plate. Give numbers above 0 and "
                f"below plate.size_m = {list(plate.size_m)}."
            )
        elif any(
            (share < _EDGE and low != "f") or (share > 1.0 - _EDGE and high != "f")
            for share, low, high in zip(shares, edges[::2], edges[1::2], strict=True)
        ):
            found.append(
                f"plate.{key} = {list(point)} lies on a supported edge. Keep a distance of "
                f"{_EDGE:g} of plate.size_m = {list(plate.size_m)}."
            )
    return found


def _beyond_simply_supported(scene: _Uncontrolled) -> list[str]:
    """What is known of a simply supported plate only."""
    plate, found = scene.plate, []
    if plate.modes is not None:
        key, words = "plate.modes", f"plate.modes of {plate.modes.file}"
    elif plate.edges not in (None, "ssss"):
        key, words = "plate.edges", f"plate.edges = '{plate.edges}'"
    elif material_called(plate.material, scene.materials or ()).orthotropic:
        key, words = "plate.material", f"{_plate_in_words(scene)}, which is orthotropic"
    else:
        return []
    if plate.radiating_faces:
        found.append(
            f"{words}: plate.radiation = '{plate.radiation}' supports a simply supported plate "
            "only. Remove one of the two."
        )
    if not SCHEMES[scene.run.scheme].supports_edges:
        found.append(
            f"{words}: run.scheme = '{scene.run.scheme}' supports a simply supported plate only. "
            f"Remove {key}, or use the scheme {supporting('supports_edges')}."
        )
    if scene.run.plate_model == "infinite" and key == "plate.material":
        found.append(
            f"{words}: run.plate_model = 'infinite' is isotropic. Use run.plate_model = 'auto'."
        )
    if scene.run.plate_model == "infinite" and plate.modes is not None:
        found.append(
            f"{words}: run.plate_model = 'infinite' has no modes. Use run.plate_model = 'auto'."
        )
    return found


def _structure_problems(scene: _Uncontrolled) -> list[str]:
    """What the tables say of the plate that does not make one structure."""
    plate = scene.plate
    if plate.modes is None:
        if plate.residual_flexibility_m_n is not None:
            return [
                f"plate.residual_flexibility_m_n = {plate.residual_flexibility_m_n:g}: needs "
                "plate.modes; for a plate it is computed. Remove the key."
            ]
        return [
            f"plate.{key}: is missing from the scene. Add it."
            for key in ("size_m", "thickness_m", "contact_point_m")
            if getattr(plate, key) is None
        ]
    found = []
    if plate.edges is not None:
        found.append(
            f"plate.edges = '{plate.edges}': cannot be combined with plate.modes, which already "
            "describe the structure. Remove one of the two."
        )
    if plate.loss_factor is not None:
        found.append(
            f"plate.loss_factor = {plate.loss_factor:g}: plate.modes give a loss factor for each "
            "mode. Remove the key."
        )
    return found


def _plate_in_words(scene: _Uncontrolled) -> str:
    """The plate's material as a sentence has it."""
    given = scene.plate.material
    name = given if isinstance(given, str) else given.name
    return f"plate.material = '{shortened(name)}'" if name else "the plate's material"


def _needs(capability: str, scheme: str, plate_model: str, key: str) -> list[str]:
    """The sentence on a key that needs a capability of the scheme, and modes."""
    if not getattr(SCHEMES[scheme], capability):
        return [
            f"{key}: not supported by run.scheme = '{scheme}'. Remove the key, or use the scheme "
            f"{supporting(capability)}."
        ]
    if plate_model == "infinite":
        return [
            f"{key}: not supported by run.plate_model = 'infinite'. Remove the key, or use "
            "run.plate_model = 'auto'."
        ]
    return []


def not_in_three_dimensions(
    striker: "Striker",
    plate: "PlateTable",
    contact: "ContactTable",
    actuator: "ActuatorTable",
    scheme: str,
    plate_model: str,
    orthotropic: bool,
) -> list[str]:
    """What does not fit a plate in three dimensions."""
    asked = "plate.theory = '3d'"
    found = _needs("supports_solid", scheme, plate_model, asked)
    only = f"{asked} supports a simply supported plate only"
    if plate.modes is not None:
        found.append(f"plate.modes of {plate.modes.file}: {only}. Use 'kirchhoff'.")
    elif plate.edges not in (None, "ssss"):
        found.append(f"plate.edges = '{plate.edges}': {only}. Remove the key, or use 'kirchhoff'.")
    elif orthotropic:
        found.append(
            f"plate.material: {asked} supports an isotropic plate only. Use another material, or "
            "'kirchhoff'."
        )
    if contact.damping != "none":
        found.append(
            f"contact.damping = '{contact.damping}': not supported by {asked}, because the "
            "velocity of a point on a solid diverges with the number of modes. Use "
            "contact.plasticity, or 'kirchhoff'."
        )
    if actuator.mass_kg is not None:
        found.append(
            f"actuator.mass_kg = {actuator.mass_kg:g}: not supported by {asked}, because a point "
            "mass on a solid diverges with the number of modes. Remove the key, or use 'kirchhoff'."
        )
    stiffness = getattr(striker, "tip_stiffness", None)
    if stiffness is not None:
        found.append(
            f"hammer.tip_stiffness = {stiffness:g}: not supported by {asked}, which needs the "
            "radius of the contact. Give hammer.tip_radius_m, or use 'kirchhoff'."
        )
    if plate.tail == "damped":
        found.append(
            f"plate.tail = 'damped': not supported by {asked}, where the truncated modes form a "
            "half space. Use 'auto'."
        )
    return found


def _tail_problems(scene: _Uncontrolled) -> list[str]:
    """Where the modes left out are no damped mode."""
    if scene.plate.tail != "damped":
        return []
    contact, actuator = scene.plate.points_m
    if scene.actuator.mass_kg is not None and contact == actuator:
        return [
            f"plate.tail = 'damped': not supported with actuator.mass_kg = "
            f"{scene.actuator.mass_kg:g} at the contact point. Use 'spring' or 'auto'."
        ]
    asked = "plate.tail = 'damped'"
    return _needs("supports_tail", scene.run.scheme, scene.run.plate_model, asked)


def _scheme_problems(scene: _Uncontrolled) -> list[str]:
    """What the chosen scheme and model of the plate do not know."""
    found = []
    contact, run = scene.contact, scene.run
    scheme = SCHEMES[run.scheme]

    def needs(capability: str, key: str) -> list[str]:
        return _needs(capability, run.scheme, run.plate_model, key)

    if contact.plasticity != "none":
        found += needs("supports_yield", f"contact.plasticity = '{contact.plasticity}'")
        plate = material_called(scene.plate.material, scene.materials or ())
        if contact.limiting_pressure_pa is None and plate.hardness_pa is plate.yield_pa is None:
            found.append(
                f"contact.plasticity = '{contact.plasticity}': the yield pressure of "
                f"{_plate_in_words(scene)} is unknown. Give plate.material.yield_pa, "
                "plate.material.hardness_pa or contact.limiting_pressure_pa, in Pa."
            )
    for key in ("bandwidth_hz", "mass_kg", "force_limit_n"):
        value = getattr(scene.actuator, key)
        if value is not None:
            found += needs("supports_actuator_dynamics", f"actuator.{key} = {value:g}")
    found += _tail_problems(scene)
    theory = STRUCTURES.get(scene.plate.theory)  # None for "auto"
    if theory is not None and theory.solid:
        striker = scene.sphere or scene.hammer
        assert striker is not None
        found += not_in_three_dimensions(
            striker, scene.plate, contact, scene.actuator, run.scheme, run.plate_model,
            material_called(scene.plate.material, scene.materials or ()).orthotropic,
        )  # fmt: skip
    if scene.plate.radiating_faces:
        found += needs("supports_radiation", f"plate.radiation = '{scene.plate.radiation}'")
    point = scene.plate.actuator_point_m
    found += _beyond_simply_supported(scene)
    apart = point is not None and point != scene.plate.contact_point_m
    if run.plate_model == "infinite":
        if not scheme.supports_infinite_plate:
            found.append(
                f"run.plate_model = 'infinite': not supported by run.scheme = '{run.scheme}'. Use "
                f"the scheme {supporting('supports_infinite_plate')}, or plate_model 'auto'."
            )
        if apart:
            found.append(
                f"plate.actuator_point_m = {list(point or ())} needs modes, which run.plate_model "
                "= 'infinite' does not have. Remove the key, or use plate_model 'auto'."
            )
    if contact.damping not in scheme.dampings:
        known = ", ".join(f"'{name}'" for name in sorted(scheme.dampings))
        others = [f"'{name}'" for name, row in SCHEMES.items() if contact.damping in row.dampings]
        found.append(
            f"contact.damping = '{contact.damping}': not supported by run.scheme = '{run.scheme}'. "
            f"Use one of {known}, or the scheme {' or '.join(others)}."
        )
    if apart and not scheme.supports_separate_actuator:
        found.append(
            f"plate.actuator_point_m = {list(point or ())} is not supported by run.scheme = "
            f"'{run.scheme}'. Remove the key, or use the scheme "
            f"{supporting('supports_separate_actuator')}."
        )
    if scheme.most_steps is not None and run.steps > scheme.most_steps:
        found.append(
            f"run.duration_s = {run.duration_s:g} gives {run.steps} steps; run.scheme = "
            f"'{run.scheme}' supports at most {scheme.most_steps}. Reduce the duration."
        )
    return found


# Keys of a table of which one stands in for the other.
_INSTEAD = {
    ("sphere", "speed_m_s"): "drop_height_m",
    ("sphere", "drop_height_m"): "speed_m_s",
    ("hammer", "tip_radius_m"): "tip_stiffness",
    ("hammer", "tip_stiffness"): "tip_radius_m",
}
_STRIKERS = ("sphere", "hammer")
_ANY = object()  # any value but None
# By table and key: the key of the same table that decides, and its value. The keys of laws are
# treated the same way, by the law that has them.
_READ_BY: dict[tuple[str, str], tuple[str, Any]] = {
    ("contact", "viscous_n_s_m"): ("damping", "viscous"),
    ("contact", "restitution"): ("damping", "hunt_crossley"),
    ("contact", "relaxation_stiffness"): ("damping", "relaxation"),
    ("contact", "relaxation_s"): ("damping", "relaxation"),
    ("contact", "relaxation_solve"): ("damping", "relaxation"),
    ("contact", "limiting_pressure_pa"): ("plasticity", "thornton"),
    ("actuator", "damping"): ("bandwidth_hz", _ANY),
}


def _reads(decided: Any, needed: Any) -> bool:
    return decided is not None if needed is _ANY else bool(decided == needed)


def unread(scene: Any) -> list[str]:
    """Sentences on keys of a scene's tables that are not at their default, but have no effect."""
    found = []
    for (name, key), (by, needed) in _READ_BY.items():
        table = getattr(scene, name)
        value, decided = getattr(table, key), getattr(table, by)
        if value == type(table).model_fields[key].default or _reads(decided, needed):
            continue
        has, give = f"with {name}.{by} = {shown(decided)}", f"{name}.{by} = {shown(needed)}"
        if needed is _ANY:
            has, give = f"without {name}.{by}", f"{name}.{by}"
        found.append(
            f"{name}.{key} = {shown(value)}: has no effect {has}. Leave the key out, or set {give}"
        )
    return found


def drop_unread(data: dict[str, Any], changed: Mapping[str, Any]) -> None:
    """Drop keys of a scene's tables that lose their effect because of the keys `changed`, or for
    which these stand in, unless they are among them."""
    for name, other in (_STRIKERS, _STRIKERS[::-1]):
        tables = {key.partition(".")[0] for key in changed}
        if name in tables and other not in tables:
            data.pop(other, None)
    for (name, key), other in _INSTEAD.items():
        if f"{name}.{key}" in changed and isinstance(data.get(name), dict):
            for lost in (other, "tip_exponent") if other == "tip_stiffness" else (other,):
                if f"{name}.{lost}" not in changed:
                    data[name].pop(lost, None)
    for (name, key), (by, needed) in _READ_BY.items():
        table, decides = data.get(name), f"{name}.{by}"
        if not isinstance(table, dict) or f"{name}.{key}" in changed:
            continue
        if decides in changed and not _reads(changed[decides], needed):
            table.pop(key, None)
