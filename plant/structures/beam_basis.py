"""Functions of one coordinate that keep the edge conditions of a plate, orthonormal by themselves.

(1+xi)^a (1-xi)^b P_k^(2b,2a)(xi) with a, b = 0 on a free edge, 1 on a simply supported and 2 on a
clamped one: Jacobi polynomials are orthogonal under just the weight that the square of the edge
factor is, so the mass matrix of any number of them is the identity.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

from hertzloop.plant.one_thread import on_one_thread

_ORDERS = {"f": 0, "s": 1, "c": 2}  # what an edge holds: nothing, the deflection, the slope as well


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
    a, b = _ORDERS[edges[0]], _ORDERS[edges[1]]
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


def families(edges: str, count: int) -> list[np.ndarray]:
    """Functions that take part together: even and odd ones apart between equal edges."""
    functions = np.arange(count)
    return [functions[::2], functions[1::2]] if edges[0] == edges[1] else [functions]
