"""Rectangular plate whose edges are clamped, free or simply supported, in any combination."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy

from hertzloop.plant.one_thread import on_one_thread
from hertzloop.plant.structures.modes import Modes, Point
from hertzloop.plant.structures.registry import Description
from hertzloop.plant.structures.structure import SizedPlate, Structure

_SHARE = 0.1  # of the accuracy asked for, in k^2 of the modes taken from Ritz's method
_LEAST = 25  # low modes that are taken however little is asked
_LOOKED_AT = 0.2  # of the low modes, to find a gap and to compare with the waves
_TAIL = 4.0  # modes left out are summed one by one up to this multiple of the limit
_WORDS = {"s": "simply supported", "c": "clamped", "f": "free"}
ORDERS = {"f": 0, "s": 1, "c": 2}  # what an edge holds: nothing, the deflection, the slope as well
_FUNCTIONS = 1600  # products of functions; a plate without any symmetry takes a second or two
_FEWEST = 12  # along an edge
_FEWER = 3  # functions along each edge, in the basis to compare with
_RIGID = 1e-3  # of the frequency of a beam as long as the plate
_ROUNDS = 40
_STRIP_ROUNDS = 4  # of strip and phase in turn
_STRIP_FUNCTIONS = 36
# Plates that share their functions: Poisson's ratios between these ends; relative error of k^4 and
# of k^2 of the waves that this may add; how many more low modes than used the functions come from;
# modes this close to others are left out; most plates solved, and nodes of waves, which need
# fewer rounds.
_ENDS, _ADDED, _ADDED_WAVES = (0.0, 0.5), 1e-6, 3e-6
_SPARE, _ALIKE = 1.05, 1e-4
_MOST_SOLVED, _MOST_NODES, _FEWER_ROUNDS = 9, 33, 16


# Functions of one coordinate that keep the edge conditions of a plate, orthonormal by themselves.
#
# (1+xi)^a (1-xi)^b P_k^(2b,2a)(xi) with a, b = 0 on a free edge, 1 on a simply supported and 2 on a
# clamped one: Jacobi polynomials are orthogonal under just the weight that the square of the edge
# factor is, so the mass matrix of any number of them is the identity.


@dataclass(frozen=True)
class BeamBasis:
    """The first `count` functions on 0..length_m between two edges, unit integral of the square."""

    edges: str  # of "csf", at 0 and at the length
    length_m: float
    count: int

    def at(self, x_m: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Values, or first or second derivatives, at places (points,); (points, count)."""
        xi = 2.0 * np.asarray(x_m, dtype=float) / self.length_m - 1.0
        values = _functions(self.edges, self.count, xi)[derivative]
        return np.asarray(values * (2.0 / self.length_m) ** (derivative + 0.5))

    def integrals(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Integrals of f_i'' f_k'', of f_i'' f_k and of f_i' f_k', each (count, count)."""
        shapes = _integrals(self.edges, self.count)
        by = 2.0 / self.length_m
        return shapes[0] * by**4, shapes[1] * by**2, shapes[2] * by**2


def _functions(edges: str, count: int, xi: np.ndarray) -> list[np.ndarray]:
    """Functions of xi in -1..1 and two derivatives, each (points, count)."""
    a, b = ORDERS[edges[0]], ORDERS[edges[1]]
    alpha, beta = 2 * b, 2 * a
    k = np.arange(count)
    # Norm of Jacobi's polynomials; 2^(alpha + beta + 1) is taken into the exponent as well.
    norm = (
        np.exp(
            (alpha + beta + 1) * np.log(2.0)
            - np.log(2 * k + alpha + beta + 1)
            + scipy.special.gammaln(k + alpha + 1)
            + scipy.special.gammaln(k + beta + 1)
            - scipy.special.gammaln(k + alpha + beta + 1)
            - scipy.special.gammaln(k + 1)
        )
        ** -0.5
    )
    x = xi[:, None]
    polynomial = [scipy.special.eval_jacobi(k, alpha, beta, x) * norm]
    for order in (1, 2):
        factor = norm
        for j in range(order):
            factor = factor * 0.5 * (k + alpha + beta + 1 + j)
        lower = np.maximum(k - order, 0)
        value = scipy.special.eval_jacobi(lower, alpha + order, beta + order, x)
        polynomial.append(np.where(k >= order, value * factor, 0.0))
    left, right = _power(1.0 + x, a), _power(1.0 - x, b)
    edge = [
        left[0] * right[0],
        left[1] * right[0] - left[0] * right[1],
        left[2] * right[0] - 2.0 * left[1] * right[1] + left[0] * right[2],
    ]
    p = polynomial
    return [
        edge[0] * p[0],
        edge[1] * p[0] + edge[0] * p[1],
        edge[2] * p[0] + 2.0 * edge[1] * p[1] + edge[0] * p[2],
    ]


def _power(u: np.ndarray, n: int) -> list[np.ndarray]:
    """u^n and its two derivatives, n = 0, 1, 2."""
    one = np.ones_like(u)
    return [[one, 0 * u, 0 * u], [u, one, 0 * u], [u * u, 2 * u, 2 * one]][n]


@lru_cache(maxsize=32)
@on_one_thread
def _integrals(edges: str, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The integrals over -1..1, exact by Gauss's rule."""
    nodes, weights = np.polynomial.legendre.leggauss(count + 5)
    value, slope, bend = _functions(edges, count, nodes)
    by_weight = weights[:, None] * bend
    return bend.T @ by_weight, by_weight.T @ value, slope.T @ (weights[:, None] * slope)


class Bending(NamedTuple):
    """Numbers of `Rigidity` that decide on shapes; see there."""

    nu: float
    twist: float
    eta: float


def isotropic(nu: float) -> Bending:
    """Of a Poisson's ratio."""
    return Bending(nu, 2.0 * (1.0 - nu), 1.0)


# Low modes of a rectangular plate with any edges by Ritz's method, and how far they converged.
#
# Energy of bending 1/2 D integral of w_xx^2 + w_yy^2 + 2 nu w_xx w_yy + twist w_xy^2, on products
# of the functions of a `BeamBasis`; its eigenvalues are k^4 = w^2 m''/D. An isotropic plate has the
# twist 2 (1 - nu); an orthotropic one comes in the coordinates of `Rigidity`.
# The mass matrix is the identity; scaled to a unit diagonal, the stiffness is as well conditioned
# as the plate. Between equal edges even and odd functions do not meet: four problems of a quarter
# the size.


@dataclass(frozen=True)
class _Block:
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
    blocks: tuple[_Block, ...]
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
def low_modes(edges: str, size_m: tuple[float, float], of: Bending) -> LowModes:
    """Modes of a plate, edges as in "csff": at x = 0, x = l_x, y = 0, y = l_y."""
    # 0.2 s of a start, for these modes alone; before the call on one thread that uses it.
    import scipy.linalg  # noqa: F401

    bases, parts, shift = _problem(edges, size_m)
    nx, ny = (basis.count for basis in bases)
    blocks, coarse = [], []
    for x, y in parts:
        values, vectors = _solved(bases, x, y, of, shift)
        blocks.append(_Block(x, y, np.sqrt(values), vectors))
        fewer = (x[x < nx - _FEWER], y[y < ny - _FEWER])
        coarse.append(np.sqrt(_solved(bases, *fewer, of, shift)[0]))
    before = np.concatenate(
        [
            np.pad(fewer, (0, len(block.squared) - len(fewer)), constant_values=math.inf)
            for fewer, block in zip(coarse, blocks, strict=True)
        ]
    )
    return _in_order(bases, blocks, before, shift)


def _in_order(
    bases: tuple[BeamBasis, BeamBasis], blocks: list[_Block], before: np.ndarray, shift: float
) -> LowModes:
    """The modes of all blocks; `before`: their k^2 in a smaller basis, (modes,)."""
    squared = np.concatenate([block.squared for block in blocks])
    rigid = squared < _RIGID * math.sqrt(shift)
    change = np.where(rigid, 0.0, before / np.where(rigid, 1.0, squared) - 1.0)
    squared[rigid] = 0.0
    order = np.argsort(squared, kind="stable")
    return LowModes(squared[order], change[order], bases, tuple(blocks), order)


def _problem(
    edges: str, size_m: tuple[float, float]
) -> tuple[tuple[BeamBasis, BeamBasis], list[tuple[np.ndarray, np.ndarray]], float]:
    """Functions along x and y, those that take part together, and the shift of k^4."""
    (nx, ny), (lx, ly) = _counts(size_m), size_m
    bases = BeamBasis(edges[:2], lx, nx), BeamBasis(edges[2:], ly, ny)
    parts = [(x, y) for x in _families(edges[:2], nx) for y in _families(edges[2:], ny)]
    return bases, parts, (math.pi / max(size_m)) ** 4


def _families(edges: str, count: int) -> list[np.ndarray]:
    """Functions that take part together: even and odd ones apart between equal edges."""
    functions = np.arange(count)
    return [functions[::2], functions[1::2]] if edges[0] == edges[1] else [functions]


def _stiffness(
    bases: tuple[BeamBasis, BeamBasis], x: np.ndarray, y: np.ndarray, of: Bending, shift: float
) -> np.ndarray:
    """Stiffness of products of functions, with the shift; linear in Poisson's ratio and twist."""
    (kx, ex, gx), (ky, ey, gy) = (
        [matrix[np.ix_(part, part)] for matrix in basis.integrals()]
        for basis, part in zip(bases, (x, y), strict=True)
    )
    stiffness = np.kron(kx, np.eye(len(y))) + np.kron(np.eye(len(x)), ky)
    stiffness += of.nu * (np.kron(ex, ey.T) + np.kron(ex.T, ey)) + of.twist * np.kron(gx, gy)
    stiffness[np.diag_indices(len(stiffness))] += shift
    return stiffness


@on_one_thread
def _solved(
    bases: tuple[BeamBasis, BeamBasis], x: np.ndarray, y: np.ndarray, of: Bending, shift: float
) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues k^4 (not below 0), rising, and orthonormal coefficients.

    Solved for 1/(k^4 + shift), of which the low modes have the largest: their rounding is
    relative to themselves, not to the highest, 1e8 times as large.
    """
    stiffness = _stiffness(bases, x, y, of, shift)
    scale = np.sqrt(np.diag(stiffness))
    lower = scipy.linalg.cholesky(stiffness / np.outer(scale, scale), lower=True)
    halved = scipy.linalg.solve_triangular(lower, np.diag(1.0 / scale), lower=True)
    inverse, vectors = np.linalg.eigh(halved @ halved.T)
    values = np.maximum(1.0 / inverse[::-1] - shift, 0.0)
    coefficients = scipy.linalg.solve_triangular(lower, vectors[:, ::-1], lower=True, trans="T")
    coefficients /= scale[:, None]
    return values, coefficients / np.linalg.norm(coefficients, axis=0)


# Low modes of plates that differ in Poisson's ratio alone.
#
# The low modes of a few such plates are functions for Ritz's method for all others between: at the
# few, they are exact, and the error between is of second order. Its bound decides how many plates
# are solved. Each further plate then costs an eigenproblem of a few hundred functions.


@dataclass(frozen=True)
class _Shared:
    """Functions of a block, orthonormal (functions, shared ones), and their stiffness at the two
    `_ENDS`; `count`: how many modes they hold."""

    x: np.ndarray
    y: np.ndarray
    functions: np.ndarray
    stiffness: tuple[np.ndarray, np.ndarray]
    count: int

    @on_one_thread
    def solved(self, nu: float) -> tuple[np.ndarray, np.ndarray]:
        """Shifted eigenvalues (modes,), rising, and coefficients of the shared functions."""
        by = (nu - _ENDS[0]) / (_ENDS[1] - _ENDS[0])
        first, last = self.stiffness
        values, vectors = np.linalg.eigh((1.0 - by) * first + by * last)
        return values[: self.count], vectors[:, : self.count]


@lru_cache(maxsize=4)
def _shared(edges: str, size_m: tuple[float, float], nu: float, count: int) -> list[_Shared]:
    """The functions that plates with Poisson's ratios between `_ENDS` share, the blocks in order;
    good for the first `count` modes, and exact at `nu`."""
    # 0.2 s of a start, for these modes alone; before the calls on one thread that use it.
    import scipy.linalg  # noqa: F401

    low = low_modes(edges, size_m, isotropic(nu))
    most = low.squared[min(int(_SPARE * count) + 10, len(low.squared) - 1)]
    share = 1.0 - (low.squared[count - 1] / most) ** 2
    shift = _problem(edges, size_m)[2]
    found: list[_Shared] = []
    for block in low.blocks:
        kept = int(np.searchsorted(block.squared, most))
        nodes = sorted({*_ENDS, nu})
        solved = {at: _snapshot(edges, size_m, at, len(found), kept) for at in _ENDS}
        solved[nu] = block.coefficients[:, :kept]
        while True:
            shared = _reduced(low.bases, block, shift, [solved[at] for at in nodes])
            middles = [0.5 * (a + b) for a, b in pairwise(nodes)]
            middles = [m for m in middles if m not in solved]
            errors = [_error(low.bases, shared, m, shift) / share for m in middles]
            if max(errors) <= _ADDED or len(nodes) >= _MOST_SOLVED:
                break
            worst = middles[int(np.argmax(errors))]
            solved[worst] = _snapshot(edges, size_m, worst, len(found), kept)
            nodes = sorted(solved)
        found.append(shared)
    return found


@lru_cache(maxsize=32)
def _snapshot(
    edges: str, size_m: tuple[float, float], nu: float, part: int, count: int
) -> np.ndarray:
    """Coefficients of the first modes of one block of a plate, (functions, count)."""
    bases, parts, shift = _problem(edges, size_m)
    return _solved(bases, *parts[part], isotropic(nu), shift)[1][:, :count].copy()


@on_one_thread
def _reduced(
    bases: tuple[BeamBasis, BeamBasis], block: _Block, shift: float, modes: list[np.ndarray]
) -> _Shared:
    """What the modes of several plates span, without what is almost the same."""
    middle = _stiffness(bases, block.x, block.y, isotropic(0.5 * sum(_ENDS)), shift)
    scale = np.sqrt(np.diag(middle))
    lower = scipy.linalg.cholesky(middle / np.outer(scale, scale), lower=True)
    # By energy: a difference of high frequency counts for more.
    energies = lower.T @ (scale[:, None] * np.concatenate(modes, axis=1))
    energies /= np.linalg.norm(energies, axis=0)
    span, size, _ = scipy.linalg.svd(energies, full_matrices=False)
    span = span[:, size > _ALIKE * size[0]]
    span = scipy.linalg.solve_triangular(lower, span, lower=True, trans="T") / scale[:, None]
    functions = np.linalg.qr(span)[0]
    first, last = (
        functions.T @ (_stiffness(bases, block.x, block.y, isotropic(nu), shift) @ functions)
        for nu in _ENDS
    )
    return _Shared(block.x, block.y, functions, (first, last), modes[0].shape[1])


@on_one_thread
def _error(bases: tuple[BeamBasis, BeamBasis], shared: _Shared, nu: float, shift: float) -> float:
    """Largest relative error of k^4, by the residuals in the norm of the inverse stiffness; the
    modes that the functions do not hold are taken to be far above."""
    values, vectors = shared.solved(nu)
    stiffness = _stiffness(bases, shared.x, shared.y, isotropic(nu), shift)
    modes = shared.functions @ vectors
    residual = stiffness @ modes - modes * values
    scale = np.sqrt(np.diag(stiffness))
    lower = scipy.linalg.cholesky(stiffness / np.outer(scale, scale), lower=True)
    left = scipy.linalg.solve_triangular(lower, residual / scale[:, None], lower=True)
    return float(np.max(np.sum(left * left, axis=0) / values))


@lru_cache(maxsize=16)
def _low_modes_near(
    edges: str, size_m: tuple[float, float], nu: float, near: float, count: int
) -> LowModes:
    """The low modes by functions shared with the plate of Poisson's ratio `near`, at least
    `count`; their `change` is not known."""
    bases, _, shift = _problem(edges, size_m)
    blocks = []
    for shared in _shared(edges, size_m, near, count):
        values, vectors = shared.solved(nu)
        squared = np.sqrt(np.maximum(values - shift, 0.0))
        blocks.append(_Block(shared.x, shared.y, squared, shared.functions @ vectors))
    unknown = np.full(sum(len(block.squared) for block in blocks), math.nan)
    return _in_order(bases, blocks, unknown, shift)


# Modes of a rectangular plate far above its first ones, by the dynamic edge effect (Bolotin 1961).
#
# Away from the edges a mode is sin(k_x x + a_x) sin(k_y y + a_y), w = sqrt(D/m'') (k_x^4 +
# 2 eta k_x^2 k_y^2 + k_y^4)^(1/2), of an isotropic plate sqrt(B'/m'') (k_x^2 + k_y^2).
# At an edge a term exp(-kappa x), kappa^2 = k_x^2 + 2 eta k_y^2, joins it, and both fulfil the
# edge's two conditions for one phase a, between -pi/2 and 0; a mode has k_x l_x + a_0 + a_1 = m
# pi, m = 1, 2, ..., and the same along y. A free edge has one mode more for every n, which is
# nearly straight across the plate or, at higher frequencies, runs along the edge and dies away
# from it: those follow from the strip between the two edges. What happens in the corners is left
# out.


class _Side(NamedTuple):
    """Shapes of modes along one coordinate: wave numbers (1/m) and their squares across, or
    (`strip`) coefficients of a `BeamBasis`, (functions, modes)."""

    k: np.ndarray
    t_squared: np.ndarray
    strip: np.ndarray | None = None

    def of(self, kept: np.ndarray) -> "_Side":
        """The same for some of the modes."""
        strip = None if self.strip is None else self.strip[:, kept]
        return _Side(self.k[kept], self.t_squared[kept], strip)


class Waves(NamedTuple):
    """Some modes of the same kind; `squared`: w sqrt(m''/D) (1/m^2), (modes,)."""

    squared: np.ndarray
    along_x: _Side
    along_y: _Side

    def within(self, least: float, most: float) -> "Waves":
        """The modes with k^2 from `least` to `most`."""
        kept = (self.squared >= least) & (self.squared <= most)
        return Waves(self.squared[kept], self.along_x.of(kept), self.along_y.of(kept))


def _squared(kx: np.ndarray, ky: np.ndarray, of: Bending) -> np.ndarray:
    """w sqrt(m''/D) of wave numbers, 1/m^2."""
    if of.eta == 1.0:
        return np.asarray(kx * kx + ky * ky)
    return np.asarray(np.sqrt(kx**4 + 2.0 * of.eta * (kx * ky) ** 2 + ky**4))


def _phase(edge: str, k: np.ndarray, t2: np.ndarray, of: Bending) -> tuple[np.ndarray, np.ndarray]:
    """Phase and weight of the exponential at an edge, k across it, t2 = t^2 along it."""
    if edge == "s":
        return np.zeros_like(k), np.zeros_like(k)
    kappa = np.sqrt(k * k + 2.0 * of.eta * t2)
    if edge == "c":
        phase = -np.arctan2(k, kappa)
        return phase, -np.sin(phase)
    a, b = k * k + of.nu * t2, k * k + (2.0 * of.eta - of.nu) * t2
    phase = -np.arctan2(k * b * b, kappa * a * a)
    return phase, a * np.sin(phase) / b


def _numbers(
    count: np.ndarray, edges: str, length: float, k: np.ndarray, t2: np.ndarray, of: Bending
) -> np.ndarray:
    """The next estimate of the wave number of mode `count` between two edges."""
    turned = _phase(edges[0], k, t2, of)[0] + _phase(edges[1], k, t2, of)[0]
    return np.asarray((count * np.pi - turned) / length)


def waves(edges: str, size_m: tuple[float, float], of: Bending, k_max: float) -> list[Waves]:
    """All modes with w sqrt(m''/D) <= k_max^2; the corners' share left out."""
    every = _labelled(edges, size_m, of, k_max)
    return [group.within(0.0, k_max * k_max) for group in every]


def _labelled(
    edges: str, size_m: tuple[float, float], of: Bending, k_max: float, rounds: int = _ROUNDS
) -> list[Waves]:
    """The modes up to k_max and some beyond, in an order that no Poisson's ratio changes."""
    (lx, ly), (ex, ey) = size_m, (edges[:2], edges[2:])
    highest = [np.arange(1.0, int(k_max * length / np.pi) + 2) for length in size_m]
    m, n = (grid.ravel() for grid in np.meshgrid(*highest, indexing="ij"))
    kx, ky = m * np.pi / lx, n * np.pi / ly
    for _ in range(rounds):
        kx, ky = _numbers(m, ex, lx, kx, ky * ky, of), _numbers(n, ey, ly, ky, kx * kx, of)
    found = [Waves(_squared(kx, ky, of), _Side(kx, ky * ky), _Side(ky, kx * kx))]
    for squared, across, along in _edge_waves(ex, ey, lx, ly, of, k_max, rounds):
        found.append(Waves(squared, across, along))
    for squared, across, along in _edge_waves(ey, ex, ly, lx, of, k_max, rounds):
        found.append(Waves(squared, along, across))
    return found


def _across(squared: np.ndarray, k2: np.ndarray, of: Bending) -> np.ndarray:
    """Square of the wave number across that belongs to k2 = k^2 along, below zero of a wave that
    dies away; 1/m^2."""
    if of.eta == 1.0:
        return np.asarray(squared - k2)
    root = np.maximum((of.eta**2 - 1.0) * k2**2 + squared**2, 0.0)
    return np.asarray(np.sqrt(root) - of.eta * k2)


@on_one_thread
def _edge_waves(
    across: str, along: str, width: float, length: float, of: Bending, k_max: float, rounds: int
) -> list[tuple[np.ndarray, _Side, _Side]]:
    """For every free edge of `across` the modes that run along it: k^2, shape across, along."""
    basis = BeamBasis(across, width, _STRIP_FUNCTIONS)
    bend, mixed, slope = basis.integrals()
    mixed = mixed + mixed.T
    at_free = basis.at(np.array([0.0 if across[0] == "f" else width]))
    n = np.arange(1.0, int(k_max * length / np.pi) + 2)
    found = []
    # Two free edges have an even and an odd mode, with almost equal k^2: each of its own functions.
    for part in _families(across, _STRIP_FUNCTIONS)[: across.count("f")]:
        inside = np.ix_(part, part)
        k, t2 = n * np.pi / length, np.zeros(len(n))
        for _ in range(_STRIP_ROUNDS):
            for _ in range(rounds):
                k = _numbers(n, along, length, k, t2, of)
            k2 = (k * k)[:, None, None]
            strip = (bend + k2 * (of.twist * slope - of.nu * mixed))[(..., *inside)]
            values, vectors = np.linalg.eigh(strip + k2 * k2 * np.eye(len(part)))
            squared = np.sqrt(np.maximum(values[:, 0], 0.0))
            t2 = np.maximum(_across(squared, k * k, of), -0.45 / of.eta * k * k)
        shape = np.zeros((_STRIP_FUNCTIONS, len(n)))
        shape[part] = vectors[:, :, 0].T
        shape *= np.sign(at_free @ shape)  # one sign at every Poisson's ratio
        found.append((squared, _Side(k, k * k, shape), _Side(k, t2)))
    return found


@lru_cache(maxsize=4)
def _nodes(
    edges: str, size_m: tuple[float, float], k_max: float
) -> tuple[np.ndarray, list[list[Waves]]]:
    """Poisson's ratios, and the modes there: polynomials through them hold for all between."""
    count, known = 9, dict[float, list[Waves]]()
    middle, half = 0.5 * sum(_ENDS), 0.5 * (_ENDS[1] - _ENDS[0])
    while True:
        ratios = middle - half * np.cos(np.arange(count) * np.pi / (count - 1))
        for nu in ratios:
            at = isotropic(float(nu))
            known.setdefault(float(nu), _labelled(edges, size_m, at, k_max, _FEWER_ROUNDS))
        found = ratios, [known[float(nu)] for nu in ratios]
        # Between two nodes in the middle the error is as large as anywhere, or almost so.
        test = 0.5 * float(ratios[count // 2] + ratios[count // 2 + 1])
        exact = _labelled(edges, size_m, isotropic(test), k_max, _FEWER_ROUNDS)
        errors = [
            float(np.max(np.abs(one.squared / other.squared - 1.0)))
            for one, other in zip(_by_nodes(*found, test), exact, strict=True)
        ]
        if max(errors) <= _ADDED_WAVES or count >= _MOST_NODES:
            return found
        count = 2 * count - 1


@lru_cache(maxsize=4)
def _left(edges: str, size_m: tuple[float, float], nu: float, k_max: float) -> list[Waves]:
    """What the polynomials miss at one of Poisson's ratios: with that added, they are exact there
    and nearly so around."""
    pairs = zip(
        _labelled(edges, size_m, isotropic(nu), k_max),
        _by_nodes(*_nodes(edges, size_m, k_max), nu),
        strict=True,
    )
    return [_summed(list(pair), np.array([1.0, -1.0])) for pair in pairs]


def _by_nodes(ratios: np.ndarray, modes: list[list[Waves]], nu: float) -> list[Waves]:
    """The labelled modes at one Poisson's ratio, by Lagrange's polynomials."""
    apart = ratios[:, None] - ratios + np.eye(len(ratios))
    parts = np.where(np.eye(len(ratios), dtype=bool), 1.0, (nu - ratios) / apart)
    weights = np.prod(parts, axis=1)
    return [_summed(list(groups), weights) for groups in zip(*modes, strict=True)]


def _summed(parts: list[Any], weights: np.ndarray) -> Any:
    """Weighted sum of arrays, or of tuples of them member by member."""
    if parts[0] is None:
        return None
    if isinstance(parts[0], np.ndarray):
        return np.tensordot(weights, np.stack(parts), 1)
    return type(parts[0])(*(_summed(list(m), weights) for m in zip(*parts, strict=True)))


@on_one_thread
def shape_along(
    edges: str, length_m: float, side: _Side, of: Bending, x_m: np.ndarray
) -> np.ndarray:
    """Shapes along a coordinate, unit integral of the square; (points, modes)."""
    x = np.asarray(x_m, dtype=float)
    if side.strip is not None:
        return BeamBasis(edges, length_m, len(side.strip)).at(x) @ side.strip
    k, t2, x = side.k, side.t_squared, x[:, None]
    (a0, c0), (a1, c1) = (_phase(edge, k, t2, of) for edge in edges)
    kappa = np.sqrt(k * k + 2.0 * of.eta * t2)
    # sin^2, then what the exponentials add: twice their product with the sine, and their square.
    norm = 0.5 * length_m + (np.sin(2.0 * a0) + np.sin(2.0 * a1)) / (4.0 * k)
    for a, c in ((a0, c0), (a1, c1)):
        norm = norm + 2.0 * c * (k * np.cos(a) + kappa * np.sin(a)) / (k * k + kappa * kappa)
        norm = norm + c * c / (2.0 * kappa)
    # Seen from the far edge the sine has the sign of -cos(m pi).
    far = -np.cos(np.round((k * length_m + a0 + a1) / np.pi) * np.pi) * c1
    inside = np.sin(k * x + a0) + c0 * np.exp(-kappa * x) + far * np.exp(-kappa * (length_m - x))
    return np.asarray(inside / np.sqrt(norm))


@dataclass(frozen=True)
class RitzAccuracy:
    """What the modes of an edged plate are worth: how many come from Ritz's method, their largest
    change against a smaller basis, and by how much the modes beyond, without the corners' share,
    are off where both are known; both relative, of the frequency."""

    low_modes: int
    low_change: float
    beyond_error: float


@dataclass(frozen=True)
class EdgedPlate(SizedPlate):
    """A plate with the edges x = 0, x = l_x, y = 0, y = l_y as named, c, f or s each.

    Low modes by Ritz's method as far as it has converged to `accuracy`, those beyond by phases
    at the edges. A plate beside another shares the functions of its modes and takes as many low
    ones.
    """

    edges: str
    accuracy: float
    near: float | None = None  # Poisson's ratio of the plate that it is `beside`
    seconds_per_mode = 7e-5

    def __str__(self) -> str:
        if len(set(self.edges)) == 1:
            return f"a plate with {_WORDS[self.edges[0]]} edges"
        return f"a plate with edges '{self.edges}'"

    @cached_property
    def quality(self) -> Mapping[str, Any]:  # type: ignore[override]
        """Fields of `RitzAccuracy`."""
        return asdict(self.reached)

    def beside(self, other: Structure) -> Structure:
        """See `Structure`."""
        if not isinstance(other, EdgedPlate) or not _ENDS[0] <= self._nu <= _ENDS[1]:
            return self
        if self.plate.orthotropic or other.plate.orthotropic:
            return self
        one, two = ((p.edges, p.size_m, p.accuracy) for p in (self, other))
        return replace(self, near=other._nu) if one == two and self._nu != other._nu else self

    def modes_below(self, frequency_hz: float) -> float:
        """About how many modes there are up to a frequency, by the modal density."""
        return self.plate.modes_below(frequency_hz)

    def modes(self, omega_max: float, contact_m: Point, actuator_m: Point) -> Modes:
        """All modes up to `omega_max` rad/s."""
        points = [contact_m] if actuator_m == contact_m else [contact_m, actuator_m]
        if self.near is None:
            omega, shapes = self._shapes(omega_max, points)
        else:  # of those that the residual flexibility needs as well
            omega, shapes = self._shapes(_TAIL * omega_max, points)
            count = int(np.searchsorted(omega, self._speed * self._most(omega_max), side="right"))
            omega, shapes = omega[:count], shapes[:count]
        return Modes(
            omega,
            self.plate.eta,
            self.plate.modal_scale_per_kg,
            shapes[:, 0],
            shapes[:, -1],
        )

    def residual_flexibility_m_n(self, omega_max: float, point_m: Point | None = None) -> float:
        """Static flexibility of all modes above `omega_max`, m/N: mode by mode up to _TAIL times
        that, beyond it, or without a point, that of an infinite plate."""
        if point_m is None:
            return self.plate.residual_flexibility_m_n(omega_max)
        omega, shapes = self._shapes(_TAIL * omega_max, [point_m])
        left_out = omega > omega_max
        summed = float(np.sum((shapes[left_out, 0] / omega[left_out]) ** 2))
        return self.plate.residual_flexibility_m_n(_TAIL * omega_max) + (
            self.plate.modal_scale_per_kg * summed
        )

    def on_grid(self, omega_max: float, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Shapes of all modes up to `omega_max` on a grid, (modes, x, y)."""
        form = self._form
        low, count, beyond, squared = _parts(form, self._most(omega_max))
        x_m, y_m = self._stretched(x_m, y_m)
        groups = [low.shapes(x_m, y_m, count)]
        for group in beyond:
            along_x, along_y = _along(form, group, x_m, y_m)
            groups.append(np.einsum("xm,ym->mxy", along_x, along_y))
        order = np.argsort(squared, kind="stable")
        return np.asarray(self._unit * np.concatenate(groups)[order])

    @property
    def reached(self) -> RitzAccuracy:
        """How far the modes are converged."""
        low, count, error = _joint(self._form.alone())
        return RitzAccuracy(count, 0.5 * float(low.change[:count].max()), 0.5 * error)

    @property
    def _nu(self) -> float:
        return self.material.poisson_ratio

    @property
    def _form(self) -> "_Form":
        bend, size_m = self.plate.rigidity, self._stretched(*self.size_m)
        of = Bending(bend.nu, bend.twist, bend.eta)
        return _Form(self.edges, size_m, of, self.accuracy, self.near)

    def _stretched(self, x: Any, y: Any) -> tuple[Any, Any]:
        """x and y in the coordinates of `Rigidity`."""
        stretch = self.plate.rigidity.stretch
        return x * stretch, y / stretch

    @property
    def _unit(self) -> float:
        """Turns a shape of unit integral into one of modal mass 1/lambda, as the plate's."""
        return 0.5 * math.sqrt(self.size_m[0] * self.size_m[1])

    @property
    def _speed(self) -> float:
        """w/k^2, m^2/s."""
        return math.sqrt(self.plate.rigidity.mean_n_m / self.plate.mass_per_area_kg_m2)

    def _most(self, omega_max: float) -> float:
        """k^2 at a frequency, 1/m^2, without the rounding: plates that differ in stiffness and mass
        alone have the same shapes up to limits in proportion, and share them."""
        return float(f"{omega_max / self._speed:.12g}")

    def _shapes(self, omega_max: float, points: list[Point]) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies (modes,) and shapes at points (modes, points)."""
        squared, shapes = _unit_shapes(
            self._form, self._most(omega_max), tuple(self._stretched(*point) for point in points)
        )
        return self._speed * squared, self._unit * shapes


class _Form(NamedTuple):
    """What the shapes of an edged plate depend on; see `EdgedPlate`."""

    edges: str
    size_m: tuple[float, float]
    of: Bending
    accuracy: float
    near: float | None

    def alone(self) -> "_Form":
        """The plate that decides on the number of low modes: beside no other."""
        of = self.of if self.near is None else isotropic(self.near)
        return self._replace(of=of, near=None)


def _parts(form: _Form, most: float) -> tuple[LowModes, int, list[Waves], np.ndarray]:
    """Low modes, how many of them are below the limit, those beyond, and k^2 of all: low ones
    first, then group by group."""
    low, count, _ = _joint(form)
    beyond = _beyond(form, most)
    count = int(np.searchsorted(low.squared[:count], most, side="right"))
    squared = np.concatenate([low.squared[:count], *(group.squared for group in beyond)])
    return low, count, beyond, squared


def _along(form: _Form, group: Waves, x_m: np.ndarray, y_m: np.ndarray) -> list[np.ndarray]:
    sides = ((form.edges[:2], group.along_x, x_m), (form.edges[2:], group.along_y, y_m))
    return [
        shape_along(of_side, length, side, form.of, places)
        for (of_side, side, places), length in zip(sides, form.size_m, strict=True)
    ]


@lru_cache(maxsize=16)
def _unit_shapes(
    form: _Form, most: float, points: tuple[Point, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """k^2 up to a limit (modes,), rising, and shapes of unit integral at points (modes, points)."""
    low, count, beyond, squared = _parts(form, most)
    shapes = np.empty((len(squared), len(points)))
    for i, (x, y) in enumerate(points):
        at = np.array([x]), np.array([y])
        groups = [low.shapes(*at, count)[:, 0, 0]]
        for group in beyond:
            along_x, along_y = _along(form, group, *at)
            groups.append(along_x[0] * along_y[0])
        shapes[:, i] = np.concatenate(groups)
    order = np.argsort(squared, kind="stable")
    return squared[order], shapes[order]


@lru_cache(maxsize=16)
def _joint(form: _Form) -> tuple[LowModes, int, float]:
    """Low modes, how many of them to take, and the relative error in k^2 of the waves there.

    As many as have converged; among the last of them the widest gap, so that no mode counts
    twice or is lost. A plate beside another takes as many as that.
    """
    edges, size_m, of, accuracy, near = form
    if near is not None:
        _, count, error = _joint(form.alone())
        return _low_modes_near(edges, size_m, of.nu, near, count), count, error
    low = low_modes(edges, size_m, of)
    unconverged = np.flatnonzero(low.change > _SHARE * accuracy)
    most = max(int(unconverged[0]) if len(unconverged) else len(low.squared) - 1, _LEAST)
    k_max = math.sqrt(1.2 * low.squared[most])
    beyond = np.sort(np.concatenate([g.squared for g in waves(edges, size_m, of, k_max)]))
    missing = _missing(edges)
    first = most - max(1, int(_LOOKED_AT * most))
    gaps = (
        beyond[first - missing + 1 : most - missing + 1] / beyond[first - missing : most - missing]
    )
    count = first + 1 + int(np.argmax(gaps))
    known = low.squared[first:count]
    error = np.abs(beyond[first - missing : count - missing] / known - 1.0)
    return low, count, float(error.max())


def _missing(edges: str) -> int:
    """Low modes that the waves do not have: nearly straight along x and y, between free edges."""
    return edges[:2].count("f") * edges[2:].count("f")


@lru_cache(maxsize=16)
def _beyond(form: _Form, most: float) -> list[Waves]:
    """The waves above the low modes, up to k^2 = `most`."""
    edges, size_m, of, _, near = form
    count = _joint(form)[1]
    k_max = math.sqrt(most)
    if near is None:
        found = waves(edges, size_m, of, k_max)
    else:
        k_top = 2.0 ** (math.ceil(8.0 * math.log2(k_max)) / 8.0)  # one for limits almost the same
        every = _by_nodes(*_nodes(edges, size_m, k_top), of.nu)
        left = _left(edges, size_m, near, k_top)
        found = [
            _summed([group, more], np.ones(2)).within(0.0, k_max * k_max)
            for group, more in zip(every, left, strict=True)
        ]
    squared = np.sort(np.concatenate([group.squared for group in found]))
    first = count - _missing(edges)
    if first >= len(squared):
        return []
    return [group.within(squared[first], math.inf) for group in found]


def made(description: Description) -> Structure:
    """A thin plate: in closed form where all edges are simply supported."""
    if description.edges == "ssss":
        return description.thin_plate
    return EdgedPlate(description.thin_plate, description.edges, description.accuracy)
