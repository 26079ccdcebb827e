"""The tables of a scene that make its plant: all but those of sensor, controller and run."""

from typing import NamedTuple

from hertzloop.plant.structures.materials import Material
from hertzloop.scene.materials import find_material
from hertzloop.scene.tables import (
    ActuatorTable,
    AnyPlate,
    AnySphere,
    ContactTable,
    MaterialTable,
    Point,
)


class PlantTables(NamedTuple):
    """The tables of a scene that make its plant, with the point of the sensor."""

    sphere: AnySphere
    plate: AnyPlate
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
