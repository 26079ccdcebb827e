"""What collides, in SI units: sphere, structure, contact and actuator."""

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

from hertzloop.common.protocols import Point, Structure
from hertzloop.plant.actuator import Actuator
from hertzloop.plant.contact.hertz import (
    Contact,
    Damping,
    Limit,
    RigidImpact,
    Sphere,
    hertz_stiffness,
    hunt_crossley_parameter,
    rigid_impact,
)
from hertzloop.plant.contact.yielding import YieldPressure, softer
from hertzloop.plant.estimates.criteria import contact_radius_m, mean_pressure_pa
from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.registry import STRUCTURES, Description, maker, structure
from hertzloop.plant.structures.structure import ComparedByParts
from hertzloop.scene.attached_files import unpack_modes
from hertzloop.scene.errors import SceneError
from hertzloop.scene.materials import find_material
from hertzloop.scene.tables import (
    ActuatorTable,
    ContactTable,
    MaterialTable,
    PlateTable,
    SphereTable,
)


class PlantTables(NamedTuple):
    """The tables of a scene that make its plant, with the point of the sensor."""

    sphere: SphereTable
    plate: PlateTable
    contact: ContactTable
    actuator: ActuatorTable
    materials: tuple[MaterialTable, ...] | None
    sensor_point_m: Point | None

    @property
    def plate_material(self) -> Material:
        """The material of the plate."""
        return find_material(self.plate.material, self.materials or ())

    @property
    def sphere_material(self) -> Material:
        """The material of the sphere."""
        return find_material(self.sphere.material, self.materials or ())


@dataclass(frozen=True, eq=False)
class Mechanics(ComparedByParts):
    """What collides, in SI units: everything that does not depend on step, law or sensor.

    `sensor_point_m`: of a sensor elsewhere; None at the contact point. `weaker`: the body that
    yields first, and its strength; None where the plate's is not known. `why_elastic`: why a
    contact that may yield by itself (`contact.plasticity` "auto") does not; "" otherwise.
    """

    sphere: Sphere
    structure: Structure
    contact: Contact
    actuator: Actuator
    contact_point_m: Point
    actuator_point_m: Point
    sensor_point_m: Point | None
    weaker: tuple[str, YieldPressure] | None
    why_elastic: str
    rigid: RigidImpact = field(compare=False)
    """the same impact on a rigid plate"""

    @property
    def same_point(self) -> bool:
        """Whether the actuator pushes at the contact point."""
        return self.structure.same_point(self.contact_point_m, self.actuator_point_m)

    @property
    def mass_at_contact(self) -> bool:
        """Whether the actuator's mass is on the contact point."""
        return self.actuator.mass_kg > 0.0 and self.same_point

    @property
    def local_plate(self) -> Plate:
        """The plate that the contact feels first. Raises SceneError where none is known."""
        if self.structure.local_plate is None:
            raise SceneError(
                "controller.law or sensors.full_scale needs the impedance of an infinite plate, "
                f"which is unknown for {self.structure}. Give plate.thickness_m if it is a plate "
                "at the contact point, or use another law and a numeric range."
            )
        return self.structure.local_plate


def resolve_mechanics(tables: PlantTables, knows_yield: bool) -> Mechanics:
    """Build the bodies, or return those that were built for the same arguments.

    Args:
        knows_yield: whether scheme and plate model know a contact that yields.

    Raises:
        SceneError: a file of modes does not make a structure.
    """
    theory = theory_of(tables.plate)
    make = maker(theory) if theory in STRUCTURES else None
    return _resolved(tables, knows_yield, make)


def theory_of(plate: PlateTable) -> str:
    """The name of the kind of structure in STRUCTURES."""
    return plate.theory if plate.modes is None else "modes"


@lru_cache(maxsize=16)
def _resolved(tables: PlantTables, knows_yield: bool, make: Any) -> Mechanics:
    """The same; `make`: function of the theory of the scene, another one after a reload."""
    plate, of_plate = tables.plate, tables.plate_material
    try:
        description = _describe_plate(plate, of_plate)
    except ValueError as error:
        raise SceneError(str(error)) from error
    ball = tables.sphere
    sphere = Sphere(
        tables.sphere_material, ball.radius_m, ball.fall_m, ball.mass_kg, ball.speed_m_s
    )
    weaker = softer(of_plate, sphere.material)
    contact, why_elastic = _contact(tables.contact, sphere, of_plate, weaker, knows_yield)
    rigid = rigid_impact(sphere, contact)
    actuator, (contact_point, actuator_point) = tables.actuator, plate.points_m
    try:
        struck = structure(theory_of(plate), description)
    except ValueError as error:
        raise SceneError(str(error)) from error
    return Mechanics(
        sphere=sphere,
        structure=struck,
        contact=contact,
        actuator=Actuator(
            actuator.bandwidth_hz,
            actuator.damping,
            actuator.mass_kg or 0.0,
            actuator.force_limit_n,
        ),
        contact_point_m=contact_point,
        actuator_point_m=actuator_point,
        sensor_point_m=struck.sensor_at(contact_point, actuator_point, tables.sensor_point_m),
        weaker=weaker,
        why_elastic=why_elastic,
        rigid=rigid,
    )


def _describe_plate(table: PlateTable, material: Material) -> Description:
    about = Description(material, table.size_m, table.thickness_m)
    modes = table.modes
    if modes is None:
        return replace(about, loss_factor=table.loss_factor, edges=table.edges or "ssss")
    content = unpack_modes(modes.file, modes.sha256, modes.content)
    flexibility = table.residual_flexibility_m_n
    return replace(about, modes=(modes.file, content), residual_flexibility_m_n=flexibility)


def _contact(
    table: ContactTable,
    sphere: Sphere,
    plate: Material,
    weaker: tuple[str, YieldPressure] | None,
    knows_yield: bool,
) -> tuple[Contact, str]:
    """Stiffness and damping of the contact, and where it yields; and `Mechanics.why_elastic`."""
    stiffness = hertz_stiffness(sphere.radius_m, sphere.material, plate)
    if table.stiffness_factor is not None:
        stiffness *= table.stiffness_factor
    limit, why_elastic = None, ""
    if table.plasticity == "auto":
        why_elastic = _why_elastic(table, sphere, stiffness, weaker, knows_yield)
    if table.plasticity != "none" and not why_elastic:
        pressure = table.limiting_pressure_pa
        if pressure is None:
            assert weaker is not None  # a scene without is refused
            pressure = weaker[1].pressure_pa
        limit = Limit(pressure, sphere.radius_m)
    damping: dict[str, Any] = {}
    if table.damping == "viscous":
        damping = {"damping": Damping.VISCOUS, "viscous_n_s_m": table.viscous_n_s_m}
    elif table.damping == "hunt_crossley":
        d = hunt_crossley_parameter(table.restitution, sphere.impact_speed_m_s)
        damping = {"damping": Damping.HUNT_CROSSLEY, "hunt_crossley_s_m": d}
    elif table.damping == "relaxation":
        damping = {
            "damping": Damping.RELAXATION,
            "relaxation_stiffness": table.relaxation_stiffness,
            "relaxation_s": table.relaxation_s,
            "extra_state": table.relaxation_solve == "bracketed",
        }
    return Contact(stiffness, limit=limit, **damping), why_elastic


def _why_elastic(
    table: ContactTable,
    sphere: Sphere,
    stiffness: float,
    weaker: tuple[str, YieldPressure] | None,
    knows_yield: bool,
) -> str:
    """Return why a contact with `contact.plasticity` "auto" does not yield; "" if it does."""
    if not knows_yield:
        return "this scheme or plate model knows no contact that yields"
    if table.damping != "none":
        return "contact.damping holds the loss of the contact"
    if table.limiting_pressure_pa is not None:
        return ""
    if weaker is None:
        return "the yield strength of the plate is not known"
    body, strength = weaker
    peak_n = rigid_impact(sphere, Contact(stiffness)).peak_n
    radius_m = contact_radius_m(peak_n, sphere.radius_m, stiffness)
    centre_pa = 1.5 * mean_pressure_pa(peak_n, radius_m)
    if centre_pa > strength.first_yield_pa:
        return ""
    return (
        f"the {body} would begin to yield at {1e-9 * strength.first_yield_pa:.3g} GPa, and the "
        f"impact on a rigid plate reaches {1e-9 * centre_pa:.3g} GPa"
    )
