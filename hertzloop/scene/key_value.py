"""The value of a scene key in a resolved setup, where the scene itself may leave it out."""

from typing import Any

from hertzloop.scene.errors import fields_of
from hertzloop.scene.setup import Setup
from hertzloop.scene.tables import KINDS

_MATERIAL_KEYS = {"young_pa": "youngs_modulus_pa", "poisson": "poisson_ratio"}


def value_of_key(setup: Setup, key: str) -> Any:
    """Return the value of "table.key" in the unit of the key; None if there is none.

    A key of another kind of the table has its default there. A limiting pressure, a loss factor and
    properties of a material may follow from other keys.
    """
    table, _, last = key.partition(".")
    if key == "contact.limiting_pressure_pa" and setup.mechanics.contact.limit is not None:
        return setup.mechanics.contact.limit.pressure_pa
    if key == "plate.loss_factor":
        plate = setup.mechanics.structure.local_plate
        return None if plate is None else plate.eta
    if key == "contact.stiffness_factor":
        return setup.scene.contact.stiffness_factor or 1.0
    if table in ("plate", "sphere") and last.startswith("material."):
        tables, name = setup.scene.plant_tables, last.partition(".")[2]
        material = tables.plate_material if table == "plate" else tables.sphere_material
        return getattr(material, _MATERIAL_KEYS.get(name, name), None)
    if table in KINDS and last in (fields := fields_of(KINDS[table].kinds())):
        default = None if fields[last].is_required() else fields[last].default
        return getattr(getattr(setup.scene, table), last, default)
    return getattr(getattr(setup.scene, table, None), last, None)
