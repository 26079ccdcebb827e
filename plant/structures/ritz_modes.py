"""Low modes of a rectangular plate with any edges by Ritz's method, and how far they converged.

Energy of bending 1/2 D integral of w_xx^2 + w_yy^2 + 2 nu w_xx w_yy + 2 (1 - nu) w_xy^2, on
products of the functions of a `BeamBasis`; its eigenvalues are k^4 = w^2 m''/D.
The mass matrix is the identity; scaled to a unit diagonal, the stiffness is as well conditioned
as the plate. Between equal edges even and odd functions do not meet: four problems of a quarter
the size.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

from hertzloop.plant.one_thread import on_one_thread
from hertzloop.plant.structures.beam_basis import BeamBasis, families

_FUNCTIONS = 1600  # products of functions; a plate without any symmetry takes a second or two
_FEWEST = 12  # along an edge
_FEWER = 3  # functions along each edge, in the basis to compare with
_RIGID = 1e-3  # of the frequency of a beam as long as the plate
_ROUNDS = 40


@dataclass(frozen=True)
class ModeBlock:
    """Modes made of some functions along x and along y: k^2 (modes,), coefficients (functions of
    x times functions of y, modes)."""

    x: np.ndarray
    y: np.ndarray
    squared: np.ndarray
    coefficients: np.ndarray


@dataclass(frozen=True)
class LowModes:
    """Modes by rising k^2 (1/m^2), 0 of a rigid plate; `change`: of k^2, relative, against a
    smaller basis; both (modes,)."""

    squared: np.ndarray
    change: np.ndarray
    bases: tuple[BeamBasis, BeamBasis]
    blocks: tuple[ModeBlock, ...]
    order: np.ndarray

    @on_one_thread
    def shapes(self, x_m: np.ndarray, y_m: np.ndarray, count: int) -> np.ndarray:
        """Shapes of the first `count` modes on a grid, (count, x, y); unit integral of squares."""
        at_x, at_y = self.bases[0].at(x_m), self.bases[1].at(y_m)
        found = np.empty((count, len(x_m), len(y_m)))
        place = np.empty(len(self.order), np.int64)
        place[self.order] = np.arange(len(self.order))
        first = 0
        for block in self.blocks:
            rows = place[first : first + len(block.squared)]
            first += len(block.squared)
            wanted = np.flatnonzero(rows < count)
            folded = block.coefficients[:, wanted].reshape(len(block.x), len(block.y), -1)
            half = np.tensordot(at_x[:, block.x], folded, 1)
            found[rows[wanted]] = np.einsum("xkm,yk->mxy", half, at_y[:, block.y], optimize=True)
        return found


def _counts(size_m: tuple[float, float]) -> tuple[int, int]:
    """Functions along x and y that resolve the same wavelength: 10 + k l/2 each."""
    lx, ly = size_m
    # (10 + k lx/2) (10 + k ly/2) = _FUNCTIONS
    a, b, c = 0.25 * lx * ly, 5.0 * (lx + ly), 100.0 - _FUNCTIONS
    k = (-b + math.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
    nx, ny = (max(_FEWEST, int(10 + 0.5 * k * length)) for length in size_m)
    return nx, ny


@lru_cache(maxsize=8)
def low_modes(edges: str, size_m: tuple[float, float], nu: float) -> LowModes:
    """Modes of a plate, edges as in "csff": at x = 0, x = l_x, y = 0, y = l_y."""
    # 0.2 s of a start, for these modes alone; before the call on one thread that uses it.
    import scipy.linalg  # noqa: F401

    bases, parts, shift = problem(edges, size_m)
    nx, ny = (basis.count for basis in bases)
    blocks, coarse = [], []
    for x, y in parts:
        values, vectors = solved_modes(bases, x, y, nu, shift)
        blocks.append(ModeBlock(x, y, np.sqrt(values), vectors))
        fewer = (x[x < nx - _FEWER], y[y < ny - _FEWER])
        coarse.append(np.sqrt(solved_modes(bases, *fewer, nu, shift)[0]))
    before = np.concatenate(
        [
            np.pad(fewer, (0, len(block.squared) - len(fewer)), constant_values=math.inf)
            for fewer, block in zip(coarse, blocks, strict=True)
        ]
    )
    return in_order(bases, blocks, before, shift)


def in_order(
    bases: tuple[BeamBasis, BeamBasis], blocks: list[ModeBlock], before: np.ndarray, shift: float
) -> LowModes:
    """The modes of all blocks; `before`: their k^2 in a smaller basis, (modes,)."""
    squared = np.concatenate([block.squared for block in blocks])
    rigid = squared < _RIGID * math.sqrt(shift)
    change = np.where(rigid, 0.0, before / np.where(rigid, 1.0, squared) - 1.0)
    squared[rigid] = 0.0
    order = np.argsort(squared, kind="stable")
    return LowModes(squared[order], change[order], bases, tuple(blocks), order)


def problem(
    edges: str, size_m: tuple[float, float]
) -> tuple[tuple[BeamBasis, BeamBasis], list[tuple[np.ndarray, np.ndarray]], float]:
    """Functions along x and y, those that take part together, and the shift of k^4."""
    (nx, ny), (lx, ly) = _counts(size_m), size_m
    bases = BeamBasis(edges[:2], lx, nx), BeamBasis(edges[2:], ly, ny)
    parts = [(x, y) for x in families(edges[:2], nx) for y in families(edges[2:], ny)]
    return bases, parts, (math.pi / max(size_m)) ** 4


def stiffness_of(
    bases: tuple[BeamBasis, BeamBasis], x: np.ndarray, y: np.ndarray, nu: float, shift: float
) -> np.ndarray:
    """Stiffness of products of functions, with the shift; linear in Poisson's ratio."""
    (kx, ex, gx), (ky, ey, gy) = (
        [matrix[np.ix_(part, part)] for matrix in basis.integrals()]
        for basis, part in zip(bases, (x, y), strict=True)
    )
    stiffness = np.kron(kx, np.eye(len(y))) + np.kron(np.eye(len(x)), ky)
    twist = 2.0 * (1.0 - nu)
    stiffness += nu * (np.kron(ex, ey.T) + np.kron(ex.T, ey)) + twist * np.kron(gx, gy)
    stiffness[np.diag_indices(len(stiffness))] += shift
    return stiffness


def factored(stiffness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cholesky's lower factor of a stiffness that is scaled to a unit diagonal, and the scale."""
    scale = np.sqrt(np.diag(stiffness))
    return scipy.linalg.cholesky(stiffness / np.outer(scale, scale), lower=True), scale


@on_one_thread
def solved_modes(
    bases: tuple[BeamBasis, BeamBasis], x: np.ndarray, y: np.ndarray, nu: float, shift: float
) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues k^4 (not below 0), rising, and orthonormal coefficients.

    Solved for 1/(k^4 + shift), of which the low modes have the largest: their rounding is
    relative to themselves, not to the highest, 1e8 times as large.
    """
    lower, scale = factored(stiffness_of(bases, x, y, nu, shift))
    halved = scipy.linalg.solve_triangular(lower, np.diag(1.0 / scale), lower=True)
    inverse, vectors = np.linalg.eigh(halved @ halved.T)
    values = np.maximum(1.0 / inverse[::-1] - shift, 0.0)
    coefficients = scipy.linalg.solve_triangular(lower, vectors[:, ::-1], lower=True, trans="T")
    coefficients /= scale[:, None]
    return values, coefficients / np.linalg.norm(coefficients, axis=0)
