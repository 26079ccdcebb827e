"""The tables of a scene that make its plant: all but those of sensor, controller and run."""

from typing import NamedTuple

from hertzloop.plant.structures.materials import Material
from hertzloop.scene.materials import find_material
from hertzloop.scene.tables import (
    ActuatorTable,
    ContactTable,
    HammerTable,
    MaterialTable,
    PlateTable,
    Point,
    SphereTable,
    Striker,
)


class PlantTables(NamedTuple):
    """The tables of a scene that make its plant, with the point of the sensor."""

    sphere: SphereTable | None
    hammer: HammerTable | None
    plate: PlateTable
    contact: ContactTable
    actuator: ActuatorTable
    materials: tuple[MaterialTable, ...] | None
    sensor_point_m: Point | None

    @property
    def striker(self) -> Striker:
        """The table of what strikes the plate; a checked scene has one."""
        found = self.sphere or self.hammer
        assert found is not None
        return found

    @property
    def plate_material(self) -> Material:
        """The material of the plate."""
        return find_material(self.plate.material, self.materials or ())

    @property
    def striker_material(self) -> Material:
        """The material of the sphere or the hammer's tip."""
        return find_material(self.striker.material, self.materials or ())
