"""A scene's tables with other values of some keys, each checked by itself and kept.

The cases of a sweep give a table the same few values again and again.
"""

import re
from collections import defaultdict
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from pydantic import BaseModel, ValidationError

from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.scenes.errors import shown
from hertzloop.scenes.materials import SceneTable

_KEPT = 4096
# What other tables, or files, have a say in.
_NOT_ALONE = {
    "plate.modes", "sensors.quantity", "controller.law", "controller.law_digest",
    "controller.latency_trace", "controller.filter_file",
}  # fmt: skip


def changed_tables(scene: BaseModel, values: Mapping[str, Any]) -> dict[str, SceneTable] | None:
    """The tables that hold the keys "table.key" of `values`, with these; None where that takes
    more than these tables, or one of them does not allow it."""
    by_table: dict[str, dict[str, Any]] = defaultdict(dict)
    for key, value in values.items():
        name, dot, last = key.partition(".")
        if key in _NOT_ALONE or not dot or "." in last:
            return None
        if last == "material" and not (isinstance(value, str) and value in MATERIALS):
            return None  # one of the scene's own, or unknown
        by_table[name][last] = value
    found = {}
    for name, changes in by_table.items():
        table = getattr(scene, name, None)
        if not isinstance(table, SceneTable):
            return None
        try:
            changed = _changed(table, tuple(changes), *changes.values())
        except TypeError:  # a list cannot be looked up
            return None
        if changed is None:
            return None
        found[name] = changed
    return found


@lru_cache(maxsize=_KEPT, typed=True)  # True is no 1
def _changed(table: SceneTable, names: tuple[str, ...], *values: Any) -> SceneTable | None:
    given = vars(table) | (table.__pydantic_extra__ or {})
    try:
        return type(table).model_validate(given | dict(zip(names, values, strict=True)))
    except ValidationError:
        return None


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
    """Drop keys of a scene's tables that lose their effect because of the keys `changed`, unless
    they are among these."""
    for (name, key), (by, needed) in _READ_BY.items():
        table, decides = data.get(name), f"{name}.{by}"
        if not isinstance(table, dict) or f"{name}.{key}" in changed:
            continue
        if decides in changed and not _reads(changed[decides], needed):
            table.pop(key, None)


_LONGEST = 80


def relabel(before: dict[str, Any], after: dict[str, Any]) -> None:
    """Give the scene `after` its settings a name that fits, unless they name it themselves.

    "aluminium-3mm" with plate.material = "titanium" is "titanium-3mm"; what it is said to show
    is left out, as it was written for another.
    """
    if not isinstance(before.get("name"), str) or after.get("name") != before["name"]:
        return
    name = before["name"]
    for old, new in (
        (_material(before, "plate"), _material(after, "plate")),
        (_radius(before), _radius(after)),
        (_material(before, "sphere"), _material(after, "sphere")),
        (_value(before, "plate", "edges"), _value(after, "plate", "edges")),
        (_file(before), _file(after)),
    ):
        if new and new != old:
            name = _with(name, old, new)
    if name == before["name"] and _thickness(before) == _thickness(after):
        return
    after["name"] = re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-_.")[:_LONGEST]
    after.pop("shows", None)


def _with(name: str, old: str, new: str) -> str:
    """The name with a word exchanged, or one more."""
    words = name.split("-")
    if old in words:
        return "-".join(new if word == old else word for word in words)
    return f"{name}-{new}"


def _value(scene: dict[str, Any], table: str, key: str) -> Any:
    found = scene.get(table)
    return found.get(key) if isinstance(found, dict) else None


def _thickness(scene: dict[str, Any]) -> Any:
    return _value(scene, "plate", "thickness_m")


def _material(scene: dict[str, Any], body: str) -> str:
    """A material's name; numbers that are none of a name's count as another material."""
    found = _value(scene, body, "material")
    if isinstance(found, dict):
        return f"own-{found.get('name') or 'material'}"
    return str(found or "")


def _radius(scene: dict[str, Any]) -> str:
    found = _value(scene, "sphere", "radius_m")
    if not isinstance(found, int | float) or isinstance(found, bool):
        return ""
    try:
        return f"{1e3 * found:g}mm"
    except OverflowError:  # a whole number beyond all radii, which is refused later
        return ""


def _file(scene: dict[str, Any]) -> str:
    found = _value(scene, "plate", "modes")
    return str(found.get("file", "")).rpartition(".")[0] if isinstance(found, dict) else ""
