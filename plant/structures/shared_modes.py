"""Modes of plates that differ in Poisson's ratio alone, in a fraction of the time: for fits.

The low modes of a few such plates are functions for Ritz's method for all others between: at the
few, they are exact, and the error between is of second order. Its bound decides how many plates
are solved. Each further plate then costs an eigenproblem of a few hundred functions. The waves
above follow from polynomials in Poisson's ratio.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import scipy

from hertzloop.plant.one_thread import on_one_thread
from hertzloop.plant.structures.beam_basis import BeamBasis
from hertzloop.plant.structures.edge_waves import Waves, labelled_waves
from hertzloop.plant.structures.ritz_modes import (
    LowModes,
    ModeBlock,
    factored,
    in_order,
    low_modes,
    problem,
    solved_modes,
    stiffness_of,
)

RATIOS = (0.0, 0.5)  # Poisson's ratios of the plates that share their functions
_ADDED, _ADDED_WAVES = 1e-6, 3e-6  # relative error that sharing may add to k^4; to k^2 of waves
_SPARE = 1.05  # more low modes than are used, that the functions come from
_ALIKE = 1e-4  # modes this close to others are left out
_MOST_SOLVED = 9  # plates
_MOST_NODES, _FEWER_ROUNDS = 33, 16  # of waves


@dataclass(frozen=True)
class SharedFunctions:
    """Functions of a block, orthonormal (functions, shared ones), and their stiffness at the two
    `RATIOS`; `count`: how many modes they hold."""

    x: np.ndarray
    y: np.ndarray
    functions: np.ndarray
    stiffness: tuple[np.ndarray, np.ndarray]
    count: int

    @on_one_thread
    def solved(self, nu: float) -> tuple[np.ndarray, np.ndarray]:
        """Shifted eigenvalues (modes,), rising, and coefficients of the shared functions."""
        by = (nu - RATIOS[0]) / (RATIOS[1] - RATIOS[0])
        first, last = self.stiffness
        values, vectors = np.linalg.eigh((1.0 - by) * first + by * last)
        return values[: self.count], vectors[:, : self.count]


@lru_cache(maxsize=4)
def _shared(
    edges: str, size_m: tuple[float, float], nu: float, count: int
) -> list[SharedFunctions]:
    """The functions that plates with Poisson's ratios between `RATIOS` share, the blocks in order;
    good for the first `count` modes, and exact at `nu`."""
    # 0.2 s of a start, for these modes alone; before the calls on one thread that use it.
    import scipy.linalg  # noqa: F401

    low = low_modes(edges, size_m, nu)
    most = low.squared[min(int(_SPARE * count) + 10, len(low.squared) - 1)]
    share = 1.0 - (low.squared[count - 1] / most) ** 2
    shift = problem(edges, size_m)[2]
    found: list[SharedFunctions] = []
    for block in low.blocks:
        kept = int(np.searchsorted(block.squared, most))
        nodes = sorted({*RATIOS, nu})
        solved = {at: _snapshot(edges, size_m, at, len(found), kept) for at in RATIOS}
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
    bases, parts, shift = problem(edges, size_m)
    return solved_modes(bases, *parts[part], nu, shift)[1][:, :count].copy()


@on_one_thread
def _reduced(
    bases: tuple[BeamBasis, BeamBasis], block: ModeBlock, shift: float, modes: list[np.ndarray]
) -> SharedFunctions:
    """What the modes of several plates span, without what is almost the same."""
    middle = 0.5 * sum(RATIOS)
    lower, scale = factored(stiffness_of(bases, block.x, block.y, middle, shift))
    # By energy: a difference of high frequency counts for more.
    energies = lower.T @ (scale[:, None] * np.concatenate(modes, axis=1))
    energies /= np.linalg.norm(energies, axis=0)
    span, size, _ = scipy.linalg.svd(energies, full_matrices=False)
    span = span[:, size > _ALIKE * size[0]]
    span = scipy.linalg.solve_triangular(lower, span, lower=True, trans="T") / scale[:, None]
    functions = np.linalg.qr(span)[0]
    first, last = (
        functions.T @ (stiffness_of(bases, block.x, block.y, nu, shift) @ functions)
        for nu in RATIOS
    )
    return SharedFunctions(block.x, block.y, functions, (first, last), modes[0].shape[1])


@on_one_thread
def _error(
    bases: tuple[BeamBasis, BeamBasis], shared: SharedFunctions, nu: float, shift: float
) -> float:
    """Largest relative error of k^4, by the residuals in the norm of the inverse stiffness; the
    modes that the functions do not hold are taken to be far above."""
    values, vectors = shared.solved(nu)
    stiffness = stiffness_of(bases, shared.x, shared.y, nu, shift)
    modes = shared.functions @ vectors
    residual = stiffness @ modes - modes * values
    lower, scale = factored(stiffness)
    left = scipy.linalg.solve_triangular(lower, residual / scale[:, None], lower=True)
    return float(np.max(np.sum(left * left, axis=0) / values))


@lru_cache(maxsize=16)
def low_modes_near(
    edges: str, size_m: tuple[float, float], nu: float, near: float, count: int
) -> LowModes:
    """The low modes by functions shared with the plate of Poisson's ratio `near`, at least
    `count`; their `change` is not known."""
    bases, _, shift = problem(edges, size_m)
    blocks = []
    for shared in _shared(edges, size_m, near, count):
        values, vectors = shared.solved(nu)
        squared = np.sqrt(np.maximum(values - shift, 0.0))
        blocks.append(ModeBlock(shared.x, shared.y, squared, shared.functions @ vectors))
    unknown = np.full(sum(len(block.squared) for block in blocks), math.nan)
    return in_order(bases, blocks, unknown, shift)


def waves_near(
    edges: str, size_m: tuple[float, float], nu: float, near: float, k_max: float
) -> list[Waves]:
    """What `waves` gives of a plate of Poisson's ratio `nu`, exact where that is `near`."""
    k_top = 2.0 ** (math.ceil(8.0 * math.log2(k_max)) / 8.0)  # one for limits almost the same
    every = _by_nodes(*_nodes(edges, size_m, k_top), nu)
    left = _left(edges, size_m, near, k_top)
    return [
        _summed([group, more], np.ones(2)).within(0.0, k_max * k_max)
        for group, more in zip(every, left, strict=True)
    ]


@lru_cache(maxsize=4)
def _nodes(
    edges: str, size_m: tuple[float, float], k_max: float
) -> tuple[np.ndarray, list[list[Waves]]]:
    """Poisson's ratios, and the modes there: polynomials through them hold for all between."""
    count, known = 9, dict[float, list[Waves]]()
    middle, half = 0.5 * sum(RATIOS), 0.5 * (RATIOS[1] - RATIOS[0])
    while True:
        ratios = middle - half * np.cos(np.arange(count) * np.pi / (count - 1))
        for nu in ratios:
            known.setdefault(
                float(nu), labelled_waves(edges, size_m, float(nu), k_max, _FEWER_ROUNDS)
            )
        found = ratios, [known[float(nu)] for nu in ratios]
        # Between two nodes in the middle the error is as large as anywhere, or almost so.
        test = 0.5 * float(ratios[count // 2] + ratios[count // 2 + 1])
        exact = labelled_waves(edges, size_m, test, k_max, _FEWER_ROUNDS)
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
        labelled_waves(edges, size_m, nu, k_max),
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
