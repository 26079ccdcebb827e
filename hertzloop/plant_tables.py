"""From a scene's tables of contact and actuator to the plant's parts."""

from dataclasses import asdict
from typing import Any

from hertzloop.scenes.scene import Scene
from hertzloop.scenes.shared import by_tables
from plant.actuator import Actuator
from plant.contact.hertz import (
    Contact,
    Damping,
    Limit,
    Sphere,
    hertz_stiffness,
    hunt_crossley_parameter,
)
from plant.contact.yielding import Strength, softer
from plant.structures.structure import Structure


def actuator_of(scene: Scene) -> Actuator:
    """The actuator between command and plate."""
    table = scene.actuator
    return Actuator(table.bandwidth_hz, table.damping, table.mass_kg or 0.0, table.force_limit_n)


@by_tables("sphere", "plate", "materials")
def weaker(scene: Scene) -> tuple[str, Strength] | None:
    """Which body yields first, and its strength; None where that of the plate is not known."""
    return softer(scene.material("plate"), scene.material("sphere"))


def limiting_pressure_pa(scene: Scene) -> float | None:
    """Limiting pressure of a contact that yields: the scene's, or by the strength of its softer
    body; None of a contact that does not."""
    table = scene.contact
    if table.plasticity != "thornton":
        return None
    if table.limiting_pressure_pa is not None:
        return table.limiting_pressure_pa
    found = weaker(scene)
    assert found is not None  # a scene without is refused
    return found[1].pressure_pa


def limit_of(scene: Scene) -> dict[str, Any] | None:
    """`pressure_pa` of a contact that yields, whether the scene `given` it, and `by` what it is
    otherwise: the `body`, with the fields of `Strength`. None of a contact that does not yield."""
    pressure, found = limiting_pressure_pa(scene), weaker(scene)
    if pressure is None:
        return None
    given = scene.contact.limiting_pressure_pa is not None
    by = None if given or found is None else {"body": found[0], **asdict(found[1])}
    return {"pressure_pa": pressure, "given": given, "by": by}


def contact_of(scene: Scene, sphere: Sphere, plate: Structure) -> Contact:
    """The contact of sphere and plate: stiffness, damping, where it yields."""
    stiffness = hertz_stiffness(sphere.radius_m, sphere.material, plate.material)
    table = scene.contact
    pressure = limiting_pressure_pa(scene)
    limit = None if pressure is None else Limit(pressure, sphere.radius_m)
    if table.damping == "viscous":
        return Contact(stiffness, Damping.VISCOUS, viscous_n_s_m=table.viscous_n_s_m, limit=limit)
    if table.damping == "hunt_crossley":
        d = hunt_crossley_parameter(table.restitution, sphere.impact_speed_m_s)
        return Contact(stiffness, Damping.HUNT_CROSSLEY, hunt_crossley_s_m=d, limit=limit)
    if table.damping == "relaxation":
        return Contact(
            stiffness,
            Damping.RELAXATION,
            relaxation_stiffness=table.relaxation_stiffness,
            relaxation_s=table.relaxation_s,
            extra_state=table.relaxation_solve == "bracketed",
        )
    return Contact(stiffness, limit=limit)
