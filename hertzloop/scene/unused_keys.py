"""Keys of a scene that have no effect beside other keys."""

from collections.abc import Mapping
from typing import Any

from hertzloop.scene.errors import shown

# Keys of a table of which one stands in for the other.
_INSTEAD = {
    ("sphere", "speed_m_s"): "drop_height_m",
    ("sphere", "drop_height_m"): "speed_m_s",
    ("plate", "modes"): "loss_factor",  # a file of modes has those of its modes
    ("plate", "material.loss_factor"): "loss_factor",
}
_ANY = object()  # any value but None
# By table and key: the key of the same table that decides, and its value or values. The keys of
# laws are treated the same way, by the law that has them.
_READ_BY: dict[tuple[str, str], tuple[str, Any]] = {
    ("contact", "viscous_n_s_m"): ("damping", "viscous"),
    ("contact", "restitution"): ("damping", "hunt_crossley"),
    ("contact", "relaxation_stiffness"): ("damping", "relaxation"),
    ("contact", "relaxation_s"): ("damping", "relaxation"),
    ("contact", "relaxation_solve"): ("damping", "relaxation"),
    ("contact", "limiting_pressure_pa"): ("plasticity", ("thornton", "auto")),
    ("actuator", "damping"): ("bandwidth_hz", _ANY),
}


def _reads(decided: Any, needed: Any) -> bool:
    if needed is _ANY:
        return decided is not None
    return decided in needed if isinstance(needed, tuple) else bool(decided == needed)


def unused_key_problems(scene: Any) -> list[str]:
    """Sentences on keys of a scene's tables that are not at their default, but have no effect."""
    found = []
    for (name, key), (by, needed) in _READ_BY.items():
        table = getattr(scene, name)
        value, decided = getattr(table, key), getattr(table, by)
        if value == type(table).model_fields[key].default or _reads(decided, needed):
            continue
        first = needed[0] if isinstance(needed, tuple) else needed
        has, give = f"with {name}.{by} = {shown(decided)}", f"{name}.{by} = {shown(first)}"
        if needed is _ANY:
            has, give = f"without {name}.{by}", f"{name}.{by}"
        found.append(
            f"{name}.{key} = {shown(value)}: has no effect {has}. Leave the key out, or set {give}"
        )
    return found


def drop_unused_keys(data: dict[str, Any], changed: Mapping[str, Any]) -> None:
    """Drop keys of a scene's tables that lose their effect because of the keys `changed`, or for
    which these stand in, unless they are among them."""
    for (name, key), other in _INSTEAD.items():
        alone = f"{name}.{key}" in changed and f"{name}.{other}" not in changed
        if alone and isinstance(data.get(name), dict):
            data[name].pop(other, None)
    for (name, key), (by, needed) in _READ_BY.items():
        table, decides = data.get(name), f"{name}.{by}"
        if not isinstance(table, dict) or f"{name}.{key}" in changed:
            continue
        if decides in changed and not _reads(changed[decides], needed):
            table.pop(key, None)
