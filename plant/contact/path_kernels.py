"""Compiled kernels of the gap within a step: the quartic through its ends, and Gauss's nodes.

See `plant.contact.solve_kernels` for what they are for.
"""

import numpy as np
from numba.extending import overload

from jit import kernel

NODES = 4
_HALVINGS = 90
# Gauss-Legendre nodes and weights on (0, 1).
_half = 0.5 * np.polynomial.legendre.leggauss(NODES)[0] + 0.5
GAUSS_T = tuple(float(x) for x in _half)
GAUSS_W = tuple(0.5 * float(x) for x in np.polynomial.legendre.leggauss(NODES)[1])
GAUSS_P = tuple(3.0 * (2.0 * t - 1.0) for t in GAUSS_T)

NOTHING = (0.0,) * 11


def by_ends(t: float) -> tuple[float, float, float, float, float]:
    """The quartic of `quartic` at t, by x0, x1, d0, d1 and the mean."""
    u = 1.0 - t
    lift = 30.0 * t * t * u * u
    return (
        (1.0 + 2.0 * t) * u * u - 0.5 * lift,
        t * t * (3.0 - 2.0 * t) - 0.5 * lift,
        t * u * u - lift / 12.0,
        lift / 12.0 - t * t * u,
        lift,
    )


BY_X0, BY_X1, BY_D0, BY_D1, BY_MEAN = zip(*(by_ends(t) for t in GAUSS_T), strict=True)


@kernel(inline=True, borrowed=True, fused=True)
def quartic(t, x0, x1, d0, d1, q):
    """Gap and its derivative by t at t in (0, 1): ends, end slopes, excess of the mean."""
    u = 1.0 - t
    gap = (
        (1.0 + 2.0 * t) * u * u * x0 + t * t * (3.0 - 2.0 * t) * x1
        + t * u * u * d0 - t * t * u * d1 + 30.0 * t * t * u * u * q
    )  # fmt: skip
    slope = (
        6.0 * t * u * (x1 - x0) + u * (1.0 - 3.0 * t) * d0 + t * (3.0 * t - 2.0) * d1
        + 60.0 * t * u * (u - t) * q
    )  # fmt: skip
    return gap, slope


@kernel(borrowed=True, fused=True)
def crossing(negative, positive, x0, x1, d0, d1, q):
    """Where the quartic changes sign between t = negative (gap < 0) and t = positive."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (negative + positive)
        if middle == negative or middle == positive:
            break
        if quartic(middle, x0, x1, d0, d1, q)[0] < 0.0:
            negative = middle
        else:
            positive = middle
    return negative


@kernel(inline=True, borrowed=True, fused=True)
def touching_part(x0, x1, d0, d1, q):
    """The part (from, to) of the step that is in contact; from = to if none is."""
    if x0 < 0.0 and x1 < 0.0:
        return 0.0, 1.0
    if x0 < 0.0:
        return 0.0, crossing(0.0, 1.0, x0, x1, d0, d1, q)
    if x1 < 0.0:
        return crossing(1.0, 0.0, x0, x1, d0, d1, q), 1.0
    if d0 < 0.0 and d1 > 0.0:  # it may dip in and out again
        lowest, at = 0.0, -1.0
        for i in range(1, 16):
            gap = quartic(i / 16.0, x0, x1, d0, d1, q)[0]
            if gap < lowest:
                lowest, at = gap, i / 16.0
        if at > 0.0:
            return (
                crossing(at, 0.0, x0, x1, d0, d1, q), crossing(at, 1.0, x0, x1, d0, d1, q)
            )  # fmt: skip
    return 0.0, 0.0


@kernel(inline=True, borrowed=True, fused=True)
def gap_at_node(i, x0, x1, d0, d1, mean):
    """Gap at node `i` of Gauss's rule."""
    return BY_X0[i] * x0 + BY_X1[i] * x1 + BY_D0[i] * d0 + BY_D1[i] * d1 + BY_MEAN[i] * mean


def added(sums, w, t, force, damping, slope, by_gap, by_slope):
    """Sums of a projection on linear functions - F_0, F_1, what damping takes (J), derivatives of
    F_0 and F_1 by x1, d1, the mean and d0 - with a node at t of weight `w` more, whose force (N)
    goes by the gap and its slope.

    Becomes part of its caller before that is compiled, which settles whether products and sums
    may be contracted.
    """
    f0, f1, lost, f0_x, f0_d, f0_m, f1_x, f1_d, f1_m, f0_s, f1_s = sums
    u = 1.0 - t
    by_q = by_gap * (30.0 * t * t * u * u) + by_slope * (60.0 * t * u * (u - t))
    by_x = by_gap * t * t * (3.0 - 2.0 * t) + by_slope * 6.0 * t * u - 0.5 * by_q
    by_d = -by_gap * t * t * u + by_slope * t * (3.0 * t - 2.0) + by_q / 12.0
    by_s = by_gap * t * u * u + by_slope * u * (1.0 - 3.0 * t) - by_q / 12.0
    p = 3.0 * (2.0 * t - 1.0)
    return (
        f0 + w * force, f1 + w * p * force, lost - w * damping * slope,
        f0_x + w * by_x, f0_d + w * by_d, f0_m + w * by_q,
        f1_x + w * p * by_x, f1_d + w * p * by_d, f1_m + w * p * by_q,
        f0_s + w * by_s, f1_s + w * p * by_s,
    )  # fmt: skip


@overload(added, inline="always", jit_options={"_nrt": False})
def _compiled_added(sums, w, t, force, damping, slope, by_gap, by_slope):
    return added
