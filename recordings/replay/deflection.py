"""Deflection of the plate at the frames of a replay."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Deflection:
    """Plate deflection as frames; up positive.

    `times_ns` (frames,), `x_m` (nx,) and `y_m` (ny,) ascending from edge to edge, `w_m`
    (frames, nx, ny). The contact point is a node of the grid. `known`: false where nothing says
    how the structure deflects, which is then drawn flat.
    """

    times_ns: np.ndarray
    x_m: np.ndarray
    y_m: np.ndarray
    w_m: np.ndarray
    contact_point_m: tuple[float, float]
    known: bool = True

    @property
    def low_m(self) -> tuple[float, float]:
        """The corner with the smallest coordinates."""
        return float(self.x_m[0]), float(self.y_m[0])

    @property
    def size_m(self) -> tuple[float, float]:
        """Lengths along x and y."""
        return float(self.x_m[-1] - self.x_m[0]), float(self.y_m[-1] - self.y_m[0])

    @property
    def contact_node(self) -> tuple[int, int]:
        """Indices of the contact point in `x_m` and `y_m`."""
        x, y = self.contact_point_m
        return int(np.argmin(abs(self.x_m - x))), int(np.argmin(abs(self.y_m - y)))
