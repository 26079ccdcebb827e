"""A structure as the plant sees it: what forces at two points can move of its modes."""

from dataclasses import fields
from functools import cached_property
from typing import Any

import numpy as np

from hertzloop.common.protocols import Point, Structure
from hertzloop.plant.structures.modes import Oscillators, grouped


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
