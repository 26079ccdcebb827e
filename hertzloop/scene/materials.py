"""Materials of a scene: a name, or a table of numbers."""

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hertzloop.common.missing_files import told_if_unreadable
from hertzloop.common.text_files import text_of
from hertzloop.plant.structures.materials import (
    MATERIALS,
    SHIPPED,
    Material,
    material_of,
    materials_of,
)
from hertzloop.scene.errors import quoted_path, shown
from hertzloop.scene.tables import MaterialKey, MaterialTable


def material_name(given: MaterialKey) -> str:
    """Name of a material; "" for numbers without a name."""
    return given if isinstance(given, str) else given.name or ""


def material_values(table: Mapping[str, Any]) -> dict[str, Any]:
    """A material's table without its name."""
    return {key: value for key, value in table.items() if key != "name" and value is not None}


def find_material(given: MaterialKey, own: tuple[MaterialTable, ...]) -> Material:
    """A material by its numbers or its name, of the scene's own first."""
    if isinstance(given, str):
        named = next((table for table in own if table.name == given), None)
        if named is None:
            return MATERIALS[given]
        given = named
    return material_of("material", material_values(given.model_dump()))


def expand_material(data: dict[str, Any], body: str) -> None:
    """Put a material's numbers in the place of its name, so that one of them can be changed."""
    table = data.get(body)
    name = table.get("material") if isinstance(table, dict) else None
    if not isinstance(table, dict) or not isinstance(name, str):
        return
    materials = data.get("materials")
    for own in materials if isinstance(materials, list | tuple) else ():
        if isinstance(own, dict) and own.get("name") == name:
            table["material"] = dict(own)
            return
    if name in SHIPPED:
        table["material"] = {"name": name, **SHIPPED[name]}


def read_materials(path: Path) -> list[dict[str, object]]:
    named = f"materials = {quoted_path(path)}"
    with told_if_unreadable(path, named, "Give the path of a file of materials."):
        text = text_of(path.read_bytes())
    return [{"name": name, **table} for name, table in materials_of(text, str(path)).items()]


_MOST_LETTERS = 80  # letters of a name that are compared


def check_materials(data: Mapping[str, Any]) -> None:
    """Raise ValueError with one sentence for what is no material in a scene's tables."""
    known = dict.fromkeys(MATERIALS)
    given = data.get("materials")
    for own in given if isinstance(given, list | tuple) else ():
        if isinstance(own, dict):
            name = str(own.get("name", ""))
            if not name:
                raise ValueError("materials: an entry has no name. Add its name.")
            material_of(f"materials: {name}", material_values(own))
            known[name] = None
    for body, key in (("plate", "material"), ("sphere", "material")):
        table = data.get(body)
        given = table.get(key) if isinstance(table, dict) else None
        if isinstance(given, dict):
            material_of(f"{body}.{key}", material_values(given))
        elif isinstance(given, str) and given not in known:
            close = difflib.get_close_matches(given[:_MOST_LETTERS], known, 1)
            hint = f"Did you mean {close[0]}? " if close else ""
            raise ValueError(
                f"{body}.{key} = {shown(given)}: unknown material. {hint}Use one of "
                f"{', '.join(known)}, or give young_pa, density_kg_m3 and poisson."
            )
