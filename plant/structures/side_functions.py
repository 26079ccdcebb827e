"""Functions of one coordinate, of which Ritz's method makes the modes of a plate by products.

They are the modes of a beam with the same edges, and for every free edge what a moment and a force
there bend it by, on a bed: a plate is bent at a free edge where a beam is not, and so would take
very many modes of the beam. All are made of Jacobi polynomials times a factor that keeps the edges:
(1+xi)^a (1-xi)^b P_k^(2b,2a)(xi) with a, b = 0 on a free edge, 1 on a simply supported and 2 on a
clamped one, which are orthonormal by themselves.
"""

import math
from typing import NamedTuple

import numpy as np
import scipy

from hertzloop.plant.one_thread import gauss

_ORDERS = {"f": 0, "s": 1, "c": 2}  # what an edge holds: nothing, the deflection, the slope as well
_MORE = 10  # polynomials than half a wave length has


class Side(NamedTuple):
    """Orthonormal functions along a side, those that take part together.

    Attributes:
        edges: of "csf", at 0 and at the length.
        length_m: of the side.
        chosen: which polynomials they are made of.
        coefficients: by polynomial and function.
        k4: k^4 of the modes of a beam (1/m^4), then zeros.
        bend, mixed, slope: integrals of f_i'' f_k'', of f_i'' f_k and of f_i' f_k'.
    """

    edges: str
    length_m: float
    chosen: np.ndarray
    coefficients: np.ndarray
    k4: np.ndarray
    bend: np.ndarray
    mixed: np.ndarray
    slope: np.ndarray

    def at(self, x_m: np.ndarray) -> np.ndarray:
        """Values at places (points,); (points, functions)."""
        found = _polynomials(self.edges, self.length_m, int(self.chosen[-1]) + 1, x_m)[0]
        return np.asarray(found[:, self.chosen] @ self.coefficients)


def sides(edges: str, length_m: float, k_max: float) -> list[Side]:
    """Functions up to a wave number (1/m): even and odd ones apart between equal edges."""
    count = _MORE + math.ceil(0.5 * k_max * length_m)
    nodes, weights = gauss(count + 5)
    values = _polynomials(edges, length_m, count, 0.5 * length_m * (nodes + 1.0))
    value, slope, bend = (v * np.sqrt(0.5 * length_m * weights)[:, None] for v in values)
    at_ends = _polynomials(edges, length_m, count, np.array([0.0, length_m]))
    every = np.arange(count)
    found = []
    for chosen in [every[::2], every[1::2]] if edges[0] == edges[1] else [every]:
        # On a bed of stiffness k^4, of waves twice as long as the shortest: its compliance is as
        # exact for low modes as they need.
        bed = (0.5 * k_max) ** 4
        stiffness = bend[:, chosen].T @ bend[:, chosen] + bed * np.eye(len(chosen))
        scale = np.sqrt(np.diag(stiffness))
        half = np.linalg.inv(np.linalg.cholesky(stiffness / np.outer(scale, scale))) / scale
        compliance = half.T @ half
        inverse, modes = np.linalg.eigh(compliance)
        k4 = np.maximum(1.0 / inverse[::-1] - bed, 0.0)
        k4 = k4[k4 <= k_max**4]
        modes = modes[:, ::-1][:, : len(k4)]
        ends = range(1 if edges[0] == edges[1] else 2)
        loads = [at_ends[n][end, chosen] for end in ends if edges[end] == "f" for n in (0, 1)]
        if loads:
            bent = compliance @ np.transpose(loads)
            for _ in range(2):  # twice, since little may be left
                bent = np.linalg.qr(bent - modes @ (modes.T @ bent))[0]
            modes = np.concatenate([modes, bent], axis=1)
        v, s, b = (of[:, chosen] @ modes for of in (value, slope, bend))
        found.append(
            Side(
                edges,
                length_m,
                chosen,
                modes,
                np.append(k4, np.zeros(len(loads))),
                b.T @ b,
                b.T @ v,
                s.T @ s,
            )
        )
    return found


def _polynomials(edges: str, length_m: float, count: int, x_m: np.ndarray) -> list[np.ndarray]:
    """Functions at places and two derivatives, each (points, count)."""
    a, b = _ORDERS[edges[0]], _ORDERS[edges[1]]
    alpha, beta = 2 * b, 2 * a
    k = np.arange(count)
    x = 2.0 * np.asarray(x_m, dtype=float)[:, None] / length_m - 1.0
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
    p, factor = [scipy.special.eval_jacobi(k, alpha, beta, x) * norm], norm
    for order in (1, 2):
        factor = factor * 0.5 * (k + alpha + beta + order)
        value = scipy.special.eval_jacobi(np.maximum(k - order, 0), alpha + order, beta + order, x)
        p.append(np.where(k >= order, value * factor, 0.0))
    left, right = _power(1.0 + x, a), _power(1.0 - x, b)
    edge = [
        left[0] * right[0],
        left[1] * right[0] - left[0] * right[1],
        left[2] * right[0] - 2.0 * left[1] * right[1] + left[0] * right[2],
    ]
    found = [
        edge[0] * p[0],
        edge[1] * p[0] + edge[0] * p[1],
        edge[2] * p[0] + 2.0 * edge[1] * p[1] + edge[0] * p[2],
    ]
    return [of * (2.0 / length_m) ** (i + 0.5) for i, of in enumerate(found)]


def _power(u: np.ndarray, n: int) -> list[np.ndarray]:
    """u^n and its two derivatives, n = 0, 1, 2."""
    one = np.ones_like(u)
    return [[one, 0 * u, 0 * u], [u, one, 0 * u], [u * u, 2 * u, 2 * one]][n]
