"""Largest values within steps, from what is known of every step."""

import numpy as np

from plant.figures import peaks_kernels as k

# Means F_0 and first moments F_1 of x^0 ... x^3 over the steps [-1, 0] and [0, 1], where over
# each step F is F_0 + F_1 P, P from -1 to 1: F_1 is 3 times the mean of F P.
_POWERS = np.arange(4)


def _moments() -> np.ndarray:
    nodes, weights = np.polynomial.legendre.leggauss(4)
    rows = []
    for middle in (-0.5, 0.5):
        powers = (middle + 0.5 * nodes)[:, None] ** _POWERS
        rows += [0.5 * weights @ powers, 1.5 * (weights * nodes) @ powers]
    return np.array(rows)


_TO_CUBIC = np.linalg.inv(_moments())


def peak_force_n(mean_n: np.ndarray, slope_n: np.ndarray) -> float:
    """Largest force of one contact within its steps, N, from F_0 and F_1 of every step.

    Of the cubic that has both of two neighbouring steps, order 4: the means are low by the
    curvature, and the ends of the steps' own lines miss by as much to either side. Without slopes,
    or of so short a contact that no two steps are whole, the largest value of these.
    """
    return float(k.peak_force(mean_n, slope_n, _TO_CUBIC))


def peak_speed_m_s(speed_m_s: np.ndarray) -> float:
    """Largest size of a speed that is known at the ends of steps, also between them: the vertex of
    the parabola through the three values around it."""
    return float(k.peak_size(speed_m_s))
