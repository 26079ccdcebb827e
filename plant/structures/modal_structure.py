"""Anything linear, known by its modes alone: what a file of modes says, as the plant sees it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from hertzloop.common.protocols import Point, Structure
from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.mode_file import ModeTable, read_modes
from hertzloop.plant.structures.modes import NO_PARTICIPATION, Modes
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.registry import Description

# The modes' mean mobility over an infinite plate's lies in between, near edges and on ribs too.
_LEAST_MOBILITY, _MOST_MOBILITY = 1 / 30, 30.0
_ENOUGH = 8  # modes for a mean


@dataclass(frozen=True, eq=False)
class ModalStructure(Structure):
    """A structure by the modes of the file `name`. `local_plate` is the plate that it is at the
    contact point, if it is one, `residual` the flexibility of the modes beyond the file, m/N.

    Raises ValueError where nothing says that flexibility, and where modes and local plate cannot
    belong together.
    """

    name: str
    # pyrefly: ignore[bad-override]
    mode_table: ModeTable = field()  # without the default of the class above
    material: Material
    local_plate: Plate | None = None
    residual: float | None = None

    # pyrefly: ignore[bad-override]
    def __post_init__(self) -> None:
        given = self.residual is not None or self.mode_table.residual_flexibility_m_n is not None
        if not given and self.local_plate is None:
            raise ValueError(
                f"{self.name} does not give residual_flexibility_m_n of the truncated modes. "
                "Give it there, as plate.residual_flexibility_m_n (0 if the modes are complete), "
                "or plate.thickness_m to take that of an infinite plate"
            )
        omega = self.mode_table.omega_rad_s
        if not given and omega[-1] == 0.0:
            raise ValueError(
                f"{self.name} has modes of a rigid body only, so plate.thickness_m does not give "
                "the flexibility of the truncated modes. Give plate.residual_flexibility_m_n (0 "
                "if the structure is rigid), or modes above 0 Hz"
            )
        ratio = self.mobility_ratio
        if ratio is not None and not _LEAST_MOBILITY <= ratio <= _MOST_MOBILITY:
            raise ValueError(
                f"the modes of {self.name} are {ratio:.2g} times as mobile as an infinite plate of "
                "plate.thickness_m and plate.material; frequency_hz must be in Hz, modal_mass_kg "
                "in kg with matching shapes. Give plate.thickness_m in m, and only for a plate."
            )

    @cached_property
    def highest_hz(self) -> float:  # type: ignore[override]  # a constant in other structures
        """Frequency limit just above the last mode, Hz."""
        return float(self.mode_table.omega_rad_s[-1]) / (2.0 * math.pi) * (1.0 + 1e-9)

    @cached_property
    def quality(self) -> Mapping[str, Any]:  # type: ignore[override]  # likewise
        """Number of modes in the file, and `mobility_ratio`."""
        return {
            "modes_in_file": len(self.mode_table.omega_rad_s),
            "mobility_ratio": self.mobility_ratio,
        }

    def __str__(self) -> str:
        return f"the modes of {self.name}"

    @property
    def mobility_ratio(self) -> float | None:
        """Mean mobility of the modes over that of the local plate: 1 for many modes away from edges
        and ribs; None where there is no such plate, or too few modes."""
        table = self.mode_table
        few = np.count_nonzero(table.shape_contact) < _ENOUGH
        if self.local_plate is None or few or table.omega_rad_s[-1] == 0.0:
            return None
        mean = np.sum(table.shape_contact**2 * table.per_modal_mass_1_kg) * math.pi / 2.0
        return float(mean / table.omega_rad_s[-1] * self.local_plate.infinite_plate_impedance_n_s_m)

    def same_point(self, contact_m: Point, actuator_m: Point) -> bool:
        """Whether the actuator pushes at the contact point: the file says so, not the points."""
        return bool(np.array_equal(self.mode_table.shape_contact, self.mode_table.shape_actuator))

    def modes_below(self, frequency_hz: float) -> float:
        """How many modes the file has up to a frequency."""
        return float(self._count(2.0 * math.pi * frequency_hz))

    def _count(self, omega_max: float) -> int:
        return int(np.searchsorted(self.mode_table.omega_rad_s, omega_max, side="right"))

    @cached_property
    def _every_mode(self) -> tuple[Modes, np.ndarray]:
        """All modes, and their shapes at the sensor. Where masses differ they are in the shapes."""
        table = self.mode_table
        seen = table.shape_contact if table.shape_sensor is None else table.shape_sensor
        shapes = [table.shape_contact, table.shape_actuator, seen]
        eta, scales = table.loss_factor, table.per_modal_mass_1_kg
        one_eta, one_scale = (bool(np.all(values == values[0])) for values in (eta, scales))
        if not one_scale:
            shapes = [shape * np.sqrt(scales) for shape in shapes]
        largest = max(np.abs(shape).max() for shape in shapes[:2])
        modes = Modes(
            table.omega_rad_s,
            float(eta[0]) if one_eta else eta,
            float(scales[0]) if one_scale else 1.0,
            shapes[0],
            shapes[1],
            NO_PARTICIPATION * float(largest),
        )
        return modes, shapes[2]

    def modes(self, omega_max: float, contact_m: Point, actuator_m: Point) -> Modes:
        """The modes up to `omega_max` rad/s."""
        of, count = self._every_mode[0], self._count(omega_max)
        return replace(
            of,
            omega=of.omega[:count],
            eta=of.eta[:count] if isinstance(of.eta, np.ndarray) else of.eta,
            at_contact=of.at_contact[:count],
            at_actuator=of.at_actuator[:count],
        )

    @property
    def has_shapes(self) -> bool:  # type: ignore[override]  # a constant in other structures
        """Whether the file has shapes on a grid."""
        return self.mode_table.grid is not None

    @property
    def grid_m(self) -> tuple[np.ndarray, np.ndarray] | None:  # type: ignore[override]
        """Axes of the grid of the file."""
        return self.mode_table.grid and self.mode_table.grid[:2]

    def on_grid(self, omega_max: float, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Shapes of all modes up to `omega_max` at places of the file's grid, (modes, x, y)."""
        if self.mode_table.grid is None:
            return super().on_grid(omega_max, x_m, y_m)
        x, y, shapes = self.mode_table.grid
        count, scale = self._count(omega_max), self._every_mode[0].scale_per_kg
        found = shapes[:count, np.searchsorted(x, x_m)][:, :, np.searchsorted(y, y_m)]
        by_mass = np.sqrt(self.mode_table.per_modal_mass_1_kg[:count] / scale)
        return np.asarray(by_mass[:, None, None] * found)

    def sensed(self, omega_max: float, contact_m: Point, sensor_m: Point) -> np.ndarray:
        """Shapes at the sensor; the file says where it is, not the points."""
        return self._every_mode[1][: self._count(omega_max)]

    def sensor_at(
        self, contact_m: Point, actuator_m: Point, sensor_m: Point | None
    ) -> Point | None:
        """Where the sensor is: the file says so. A point of no plate stands for one of its own."""
        table, sensed = self.mode_table, self.mode_table.shape_sensor
        if sensed is None or np.array_equal(sensed, table.shape_contact):
            return None
        return actuator_m if np.array_equal(sensed, table.shape_actuator) else (math.inf, math.inf)

    @cached_property
    def pushed_at_sensor(self) -> "ModalStructure":
        """The structure with the actuator where the sensor is."""
        seen = self.mode_table.shape_sensor
        if seen is None:
            return self
        return replace(self, mode_table=replace(self.mode_table, shape_actuator=seen))

    @cached_property
    def struck_at_actuator(self) -> "ModalStructure":
        """The structure with the contact where the actuator is."""
        table = self.mode_table
        return replace(self, mode_table=replace(table, shape_contact=table.shape_actuator))

    def residual_flexibility_m_n(self, omega_max: float, point_m: Point | None = None) -> float:
        """Static flexibility at the contact of all modes above `omega_max`, m/N: those of the file
        and what is said of those beyond, or that of an infinite plate. The file says where that is,
        not the point."""
        table = self.mode_table
        beyond = self.residual if self.residual is not None else table.residual_flexibility_m_n
        if beyond is None:
            assert self.local_plate is not None
            beyond = self.local_plate.residual_flexibility_m_n(float(table.omega_rad_s[-1]))
        out = table.omega_rad_s > omega_max
        if not out.any():
            return beyond
        terms = (
            table.per_modal_mass_1_kg[out]
            * (table.shape_contact[out] / table.omega_rad_s[out]) ** 2
        )
        return beyond + float(np.sum(terms))


def made(description: Description) -> ModalStructure:
    """The structure of a file of modes; with a thickness it is a plate at the contact point."""
    assert description.modes is not None
    name, content = description.modes
    local = None
    if description.thickness_m is not None:
        local = Plate(description.material, (1.0, 1.0), description.thickness_m)  # modes have sizes
    return ModalStructure(
        name,
        read_modes(name, content),
        description.material,
        local,
        description.residual_flexibility_m_n,
    )
