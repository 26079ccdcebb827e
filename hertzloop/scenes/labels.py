"""The name of a scene follows what really runs when settings change who meets what."""

import re
from typing import Any

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
