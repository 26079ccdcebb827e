"""What collides, in SI units: sphere, structure, contact and actuator."""

from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from typing import Any

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
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.modes import Point
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.registry import STRUCTURES, Description, maker, structure
from hertzloop.plant.structures.structure import Structure, compared_as
from hertzloop.scene.attached_files import unpack_modes
from hertzloop.scene.errors import SceneError
from hertzloop.scene.plant_tables import PlantTables
from hertzloop.scene.tables import ContactTable, PlateTable, SphereTable


@dataclass(frozen=True, eq=False)
class Mechanics:
    """What collides, in SI units: everything that does not depend on step, law or sensor.

    `sensor_point_m`: of a sensor elsewhere; None at the contact point. `weaker`: the body that
    yields first, and its strength; None where the plate's is not known.
    """

    sphere: Sphere
    structure: Structure
    contact: Contact
    actuator: Actuator
    contact_point_m: Point
    actuator_point_m: Point
    sensor_point_m: Point | None
    weaker: tuple[str, YieldPressure] | None
    rigid: RigidImpact = field(compare=False)
    """the same impact on a rigid plate"""

    @property
    def same_point(self) -> bool:
        """Whether the actuator pushes at the contact point."""
        return self.contact_point_m == self.actuator_point_m

    @property
    def mass_at_contact(self) -> bool:
        """Whether the actuator's mass is on the contact point."""
        return self.actuator.mass_kg > 0.0 and self.same_point

    @cached_property
    def _parts(self) -> tuple[Any, ...]:
        compared = (part.name for part in fields(self) if part.compare)
        return tuple(compared_as(getattr(self, name)) for name in compared)

    @cached_property
    def _hash(self) -> int:
        return hash(self._parts)

    def __hash__(self) -> int:
        """Computed once: a case of a sweep looks up what follows from it eight times."""
        return self._hash

    def __eq__(self, other: object) -> bool:
        """Whether both are the same bodies."""
        return isinstance(other, Mechanics) and self._parts == other._parts

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


def resolve_mechanics(tables: PlantTables, accuracy: float) -> Mechanics:
    """Build the bodies, or return those that were built for the same arguments.

    Args:
        accuracy: `run.accuracy`, by which the number of Ritz functions is chosen.

    Raises:
        SceneError: a file of modes does not make a structure.
    """
    theory = tables.plate.theory
    make = maker(theory) if theory in STRUCTURES else None
    return _resolved(tables, accuracy, make)


@lru_cache(maxsize=16)
def _resolved(tables: PlantTables, accuracy: float, make: Any) -> Mechanics:
    """The same; `make`: function of the theory of the scene, another one after a reload."""
    plate, of_plate = tables.plate, tables.plate_material
    try:
        description = _describe_plate(plate, of_plate, accuracy)
    except ValueError as error:
        raise SceneError(str(error)) from error
    sphere, contact, weaker = _impact(
        tables.sphere, tables.contact, tables.sphere_material, of_plate
    )
    rigid = rigid_impact(sphere, contact)
    actuator, (contact_point, actuator_point) = tables.actuator, plate.points_m
    try:
        struck = structure("modes" if plate.modes else plate.theory, description)
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
        rigid=rigid,
    )


def _describe_plate(table: PlateTable, material: Material, accuracy: float) -> Description:
    modes = table.modes
    content = None if modes is None else unpack_modes(modes.file, modes.sha256, modes.content)
    return Description(
        material=material,
        size_m=table.size_m,
        thickness_m=table.thickness_m,
        loss_factor=table.loss_factor,
        edges=table.edges or "ssss",
        accuracy=accuracy,
        modes=None if modes is None or content is None else (modes.file, content),
        residual_flexibility_m_n=table.residual_flexibility_m_n,
    )


def _impact(
    given: SphereTable, table: ContactTable, own: Material, plate: Material
) -> tuple[Sphere, Contact, tuple[str, YieldPressure] | None]:
    """The sphere, of a material of its `own`; its contact: stiffness, damping, and where it yields;
    and the body that yields first, see `Mechanics`."""
    weaker = softer(plate, own)
    height, speed = given.drop_height_m, given.speed_m_s
    if height is None:
        assert speed is not None  # a scene without either is refused
        height = speed**2 / (2.0 * GRAVITY_M_S2)
    sphere = Sphere(own, given.radius_m, height, given.mass_kg, speed)
    stiffness = hertz_stiffness(sphere.radius_m, own, plate)
    if table.stiffness_factor is not None:
        stiffness *= table.stiffness_factor
    limit = None
    if table.plasticity == "thornton":
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
    return sphere, Contact(stiffness, limit=limit, **damping), weaker
