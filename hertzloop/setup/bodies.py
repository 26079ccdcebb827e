"""First stage: the sphere, the structure, their contact and the actuator."""

from dataclasses import asdict, dataclass, field, fields
from functools import lru_cache
from typing import Any

from hertzloop.plant.actuator import Actuator
from hertzloop.plant.contact.hertz import (
    HERTZ,
    Contact,
    Damping,
    Limit,
    Sphere,
    hertz_stiffness,
    hunt_crossley_parameter,
)
from hertzloop.plant.contact.yielding import Strength, softer
from hertzloop.plant.estimates.plate_theory import KirchhoffError, expected_kirchhoff_error
from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.modes import Point
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.registry import Description, structure
from hertzloop.plant.structures.structure import Structure
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.materials import MaterialTable, material_called, unpacked
from hertzloop.scenes.scene import not_in_three_dimensions
from hertzloop.scenes.tables import ActuatorTable, ContactTable, PlateTable, Striker

KEPT = 16  # results of a stage; a structure's modes can be large


@dataclass(frozen=True)
class Bodies:
    """What collides, in SI units: everything that does not depend on step, law or sensor.

    `weaker`: the body that yields first, and its strength; None where the plate's is not known.
    `sensor_point_m`: of a sensor elsewhere; None at the contact point.
    `theory`: "kirchhoff" or "3d", the theory that `plate.theory` comes to.
    """

    sphere: Sphere
    structure: Structure
    contact: Contact
    actuator: Actuator
    contact_point_m: Point
    actuator_point_m: Point
    sensor_point_m: Point | None
    sensor_mass_kg: float
    radiating_faces: int
    weaker: tuple[str, Strength] | None
    theory: str
    why_not_solid: str | None = field(compare=False)
    """why the plate cannot be in three dimensions; None if it can"""

    same_point: bool = field(init=False, repr=False, compare=False)
    """whether the actuator pushes at the contact point"""
    mass_at_contact: bool = field(init=False, repr=False, compare=False)
    """whether the actuator's or the sensor's mass is on the contact point"""

    def __post_init__(self) -> None:
        """The hash is kept: later stages are looked up by it again and again."""
        same = self.contact_point_m == self.actuator_point_m
        of_sensor = self.sensor_mass_kg > 0.0 and self.sensor_point_m is None
        vars(self).update(
            same_point=same,
            mass_at_contact=of_sensor or (self.actuator.mass_kg > 0.0 and same),
            _hash=hash(tuple(getattr(self, part.name) for part in fields(self) if part.compare)),
        )

    def __hash__(self) -> int:
        kept: int = vars(self)["_hash"]
        return kept

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


@lru_cache(maxsize=KEPT)
def bodies_of(
    striker: Striker,
    plate: PlateTable,
    contact_table: ContactTable,
    actuator_table: ActuatorTable,
    materials: tuple[MaterialTable, ...] | None,
    scheme: str,
    plate_model: str,
    accuracy: float,
    sensor: tuple[Point | None, float],
) -> Bodies:
    """Build the bodies.

    Args:
        materials: the scene's own, by name.
        scheme: `run.scheme`; a solid plate is known to one of them only.
        plate_model: `run.plate_model` as the scene has it; an infinite plate is thin.
        accuracy: `run.accuracy`, by which the theory and the number of Ritz functions are chosen.
        sensor: point and mass (kg) of the sensor.

    Raises:
        SceneError: a file of modes does not make a structure.
    """
    of_sphere = material_called(striker.material, materials or ())
    of_plate = material_called(plate.material, materials or ())
    sphere = striker.striker(of_sphere)
    weaker = softer(of_plate, of_sphere)
    tip = getattr(striker, "tip_stiffness", None), getattr(striker, "tip_exponent", None)
    contact = _contact(contact_table, sphere, of_plate, weaker, *tip)
    try:
        description = _described(plate, of_plate, accuracy)
    except ValueError as error:
        raise SceneError(str(error)) from error
    thin_only = not_in_three_dimensions(
        striker, plate, contact_table, actuator_table, scheme, plate_model,
        of_plate.orthotropic, sensor[1] or None,
    )  # fmt: skip
    theory = plate.theory
    if theory == "auto":
        theory = "kirchhoff"
        if not thin_only:
            expected = expected_kirchhoff_error(sphere, description.thin_plate, contact)
            theory = "kirchhoff" if expected.largest <= accuracy else "3d"
    contact_point, actuator_point = plate.points_m
    try:
        struck = structure("modes" if plate.modes else theory, description)
    except ValueError as error:
        raise SceneError(str(error)) from error
    return Bodies(
        sphere=sphere,
        structure=struck,
        contact=contact,
        actuator=Actuator(
            actuator_table.bandwidth_hz,
            actuator_table.damping,
            actuator_table.mass_kg or 0.0,
            actuator_table.force_limit_n,
        ),
        contact_point_m=contact_point,
        actuator_point_m=actuator_point,
        sensor_point_m=struck.sensor_at(contact_point, actuator_point, sensor[0]),
        sensor_mass_kg=sensor[1],
        radiating_faces=plate.radiating_faces,
        weaker=weaker,
        theory=theory,
        why_not_solid=thin_only[0] if thin_only else None,
    )


def _described(table: PlateTable, material: Material, accuracy: float) -> Description:
    modes = table.modes
    content = None if modes is None else unpacked(modes.file, modes.sha256, modes.content)
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


def _contact(
    table: ContactTable, sphere: Sphere, plate: Material, weaker: tuple[str, Strength] | None,
    tip_stiffness: float | None, tip_exponent: float | None,
) -> Contact:  # fmt: skip
    """The contact of sphere and plate: stiffness, damping, exponent, and where it yields."""
    stiffness, exponent = tip_stiffness, tip_exponent or HERTZ
    if stiffness is None:
        stiffness = hertz_stiffness(sphere.radius_m, sphere.material, plate)
    if table.stiffness_factor is not None:
        stiffness *= table.stiffness_factor
    limit = None
    if table.plasticity == "thornton":
        pressure = table.limiting_pressure_pa
        if pressure is None:
            assert weaker is not None  # a scene without is refused
            pressure = weaker[1].pressure_pa
        limit = Limit(pressure, sphere.radius_m)
    if table.damping == "viscous":
        return Contact(
            stiffness, Damping.VISCOUS, viscous_n_s_m=table.viscous_n_s_m, limit=limit,
            exponent=exponent,
        )  # fmt: skip
    if table.damping == "hunt_crossley":
        d = hunt_crossley_parameter(table.restitution, sphere.impact_speed_m_s)
        return Contact(
            stiffness, Damping.HUNT_CROSSLEY, hunt_crossley_s_m=d, limit=limit, exponent=exponent
        )
    if table.damping == "relaxation":
        return Contact(
            stiffness,
            Damping.RELAXATION,
            relaxation_stiffness=table.relaxation_stiffness,
            relaxation_s=table.relaxation_s,
            extra_state=table.relaxation_solve == "bracketed",
        )
    return Contact(stiffness, limit=limit, exponent=exponent)


def limiting_pressure(bodies: Bodies, table: ContactTable) -> dict[str, Any] | None:
    """`pressure_pa` of a contact that yields, whether the scene `given` it, and `by` what it is
    otherwise: the `body`, with the fields of `Strength`. None of a contact that does not yield."""
    if bodies.contact.limit is None:
        return None
    given = table.limiting_pressure_pa is not None
    found = bodies.weaker
    by = None if given or found is None else {"body": found[0], **asdict(found[1])}
    return {"pressure_pa": bodies.contact.limit.pressure_pa, "given": given, "by": by}


def thin_plate_error(bodies: Bodies) -> KirchhoffError:
    """What Kirchhoff's theory is expected to cost the first impact of a plate by its sizes."""
    return expected_kirchhoff_error(bodies.sphere, bodies.local_plate, bodies.contact)
