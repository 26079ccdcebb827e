"""What is struck, as the plant sees it: the modes of something linear, at two points."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from plant.structures.materials import Material

if TYPE_CHECKING:
    from plant.structures.plate import Plate

Point = tuple[float, float]
NO_PARTICIPATION = 1e-9  # of a shape's largest value


@dataclass(frozen=True)
class Modes:
    """Modes by rising frequency, arrays (modes,): q'' + eta w q' + w^2 q = lambda (phi_c F_c +
    phi_a F_a), the contact moves by phi_c q, the actuator by phi_a q.

    `eta` is one loss factor for all, or an array; `scale_per_kg` is lambda, the inverse modal
    mass; a shape below `silent_below` is a node. A mode of frequency zero is a rigid body's.
    """

    omega: np.ndarray
    eta: float | np.ndarray
    scale_per_kg: float
    at_contact: np.ndarray
    at_actuator: np.ndarray
    silent_below: float = NO_PARTICIPATION


class Structure(Protocol):
    """Anything linear that a sphere can fall on. What we ship and what a user brings are the same
    to the plant; points are in m from the structure's corner."""

    @property
    def material(self) -> Material:
        """Of the struck surface."""

    @property
    def local_plate(self) -> "Plate | None":
        """The plate that a contact feels until reflections return; None if there is none."""

    def same_point(self, contact_m: Point, actuator_m: Point) -> bool:
        """Whether the actuator pushes at the struck point."""

    def modes_below(self, frequency_hz: float) -> float:
        """About how many modes there are up to a frequency."""

    def modes(self, omega_max: float, contact_m: Point, actuator_m: Point) -> Modes:
        """All modes up to `omega_max` rad/s."""

    def residual_flexibility_m_n(self, omega_max: float, point_m: Point | None = None) -> float:
        """Static flexibility of all modes above `omega_max`, m/N, at a point, or (None) about."""
