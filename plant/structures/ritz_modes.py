"""Modes of a rectangular plate with any edges by Ritz's method.

Energy of bending 1/2 D integral of w_xx^2 + w_yy^2 + 2 nu w_xx w_yy + 2 (1 - nu) w_xy^2, on
products of functions along both sides; its eigenvalues are k^4 = w^2 m''/D. Of the products those
are taken whose k_x^2 + k_y^2 is not far above k^2 of the highest mode: some 1.6 a mode. Between
equal edges even and odd functions do not meet: problems of a half or a quarter the size.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hertzloop.plant.one_thread import on_one_thread
from hertzloop.plant.structures.side_functions import Side, sides

_HIGHER = 1.25  # wave numbers of the products over that of the highest mode
_RIGID = 1e-3  # of the frequency of a beam as long as the plate


@dataclass(frozen=True)
class Block:
    """Modes of products of some functions x[i] y[j]: k^2, rising, and coefficients (products,
    modes)."""

    x: Side
    y: Side
    i: np.ndarray
    j: np.ndarray
    squared: np.ndarray
    coefficients: np.ndarray


@dataclass(frozen=True)
class RitzModes:
    """Modes by rising k^2 (1/m^2), 0 of a rigid plate, (modes,); those of `order[0]`, ... of all
    blocks one after the other."""

    squared: np.ndarray
    order: np.ndarray
    blocks: tuple[Block, ...]

    @on_one_thread
    def shapes(self, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Shapes on a grid, (modes, x, y); unit integral of squares."""
        found = []
        for block in self.blocks:
            at_x, at_y = block.x.at(x_m)[:, block.i], block.y.at(y_m)[:, block.j]
            along = [(at_x[n] * at_y) @ block.coefficients for n in range(len(x_m))]
            found.append(np.stack(along).transpose(2, 0, 1))
        return np.concatenate(found)[self.order]


@lru_cache(maxsize=4)
@on_one_thread
def ritz_modes(edges: str, size_m: tuple[float, float], nu: float, k_max: float) -> RitzModes:
    """The modes up to a wave number (1/m); edges at x = 0, x = l_x, y = 0, y = l_y."""
    highest = _HIGHER * k_max
    of_x, of_y = (sides(edges[2 * n : 2 * n + 2], size_m[n], highest) for n in (0, 1))
    blocks = tuple(_block(x, y, nu, k_max) for x in of_x for y in of_y)
    squared = np.concatenate([block.squared for block in blocks])
    squared[squared < _RIGID * (math.pi / max(size_m)) ** 2] = 0.0
    order = np.argsort(squared, kind="stable")
    return RitzModes(squared[order], order, blocks)


def _block(x: Side, y: Side, nu: float, k_max: float) -> Block:
    k2 = np.sqrt(x.k4)[:, None] + np.sqrt(y.k4)
    i, j = np.nonzero(k2 <= (_HIGHER * k_max) ** 2)
    in_x, in_y = np.ix_(i, i), np.ix_(j, j)
    stiffness = x.bend[in_x] * (j[:, None] == j)
    stiffness += y.bend[in_y] * (i[:, None] == i)
    stiffness += nu * (x.mixed[in_x] * y.mixed.T[in_y])
    stiffness += nu * (x.mixed.T[in_x] * y.mixed[in_y])
    stiffness += 2.0 * (1.0 - nu) * (x.slope[in_x] * y.slope[in_y])
    k4, coefficients = np.linalg.eigh(stiffness)
    squared = np.sqrt(np.maximum(k4, 0.0))
    known = squared <= k_max**2
    return Block(x, y, i, j, squared[known], coefficients[:, known].copy())
