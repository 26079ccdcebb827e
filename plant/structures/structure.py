"""A structure as the plant sees it: the modes of something linear, at two points."""

from dataclasses import fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.modes import ModeSource, Oscillators, Point, grouped
from hertzloop.plant.structures.plate import Plate


class Structure(ModeSource, Protocol):
    """Anything linear that a sphere can fall on, and what it offers beyond its modes.

    What we ship and what a user brings are the same to the plant. Points are in m from the
    structure's corner. A class of one's own inherits from this one, and with it an answer to
    whatever it does not offer: where a member has a body, that holds for any set of modes.
    """

    if TYPE_CHECKING:  # else a dataclass could not have a field of this name

        @property
        def material(self) -> Material:
            """Material of the surface at the contact point."""

    @property
    def local_plate(self) -> Plate | None:
        """The plate that a contact feels until reflections return; None if there is none."""
        return None

    @property
    def size_m(self) -> tuple[float, float] | None:
        """Length and width of the grid that `on_grid` can be asked for, m; None without shapes."""
        return None

    def on_grid(self, omega_max: float, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Shapes of all modes up to `omega_max` on a grid, (modes, x, y). Raises ValueError where
        `size_m` is None."""
        raise ValueError(f"{self} has no shapes on a grid")

    @property
    def simply_supported(self) -> Plate | None:
        """The simply supported plate that it is, whose modes are products of sines; None if it is
        none. Radiation efficiencies are known of these only."""
        return None

    @property
    def fundamental_hz(self) -> float | None:
        """Frequency of its lowest mode, Hz, where that is known without its modes."""
        return None


class ComparedByParts:
    """Equality and hash of a frozen dataclass (`eq=False`) by its fields, the hash computed once:
    many results are cached by the description of their plant.

    A structure that has no hash, as one whose fields are arrays, is itself alone: each is made once
    for what a scene says.
    """

    @cached_property
    def _parts(self) -> tuple[Any, ...]:
        compared = (part.name for part in fields(self) if part.compare)  # type: ignore[arg-type]
        return tuple(_compared_as(getattr(self, name)) for name in compared)

    @cached_property
    def _hash(self) -> int:
        return hash(self._parts)

    def __hash__(self) -> int:
        """That of the parts."""
        return self._hash

    def __eq__(self, other: object) -> bool:
        """Whether all parts are the same."""
        return isinstance(other, type(self)) and self._parts == other._parts


def _compared_as(part: Any) -> Any:
    try:
        hash(part)
    except TypeError:
        return id(part)
    return part


def oscillators(
    structure: Structure,
    contact_m: Point,
    actuator_m: Point,
    omega_max: float,
    sensor_m: Point | None = None,
) -> Oscillators:
    """Reduce the modes below `omega_max` to what forces at two points move; see `grouped`.

    `sensor_m`: of a sensor elsewhere. Raises ValueError when no mode is left.
    """
    modes = structure.modes(omega_max, contact_m, actuator_m)
    seen = None if sensor_m is None else structure.sensed(omega_max, contact_m, sensor_m)
    groups = grouped(modes, structure.same_point(contact_m, actuator_m))
    if not groups.table.shape[1]:
        raise ValueError(
            f"no mode below {omega_max / (2 * np.pi):g} Hz moves the contact point. "
            "Use a smaller step or another contact point."
        )
    eta = modes.eta[groups.place] if isinstance(modes.eta, np.ndarray) else modes.eta
    omega, at_contact, at_actuator = groups.table
    sensor = None if seen is None else groups.shapes(seen)
    return Oscillators(
        omega, at_contact, at_actuator, len(modes.omega), eta, modes.scale_per_kg, sensor
    )


def frequencies(structure: Structure, contact_m: Point, actuator_m: Point, omega_max: float) -> int:
    """How many oscillators there are below a limit, zero without any."""
    try:
        return len(oscillators(structure, contact_m, actuator_m, omega_max).omega)
    except ValueError:
        return 0
