"""Largest values within steps, from what is known of every step."""

import math

import numpy as np

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
_WHOLE = 4  # steps that a contact has at least, for two whole ones beside each other


def peak_force_n(mean_n: np.ndarray, slope_n: np.ndarray) -> float:
    """Largest force of one contact within its steps, N, from F_0 and F_1 of every step.

    Of the cubic that has both of two neighbouring steps, order 4: the means are low by the
    curvature, and the ends of the steps' own lines miss by as much to either side. Without slopes,
    or of so short a contact that no two steps are whole, the largest value of these.
    """
    if not np.any(slope_n):
        return float(np.max(mean_n))
    ends = mean_n + np.abs(slope_n)
    if len(mean_n) < _WHOLE:
        return float(np.max(ends))
    highest = int(np.argmax(mean_n))
    firsts = [i for i in (highest - 1, highest) if 0 < i < len(mean_n) - 2]
    found = []
    for i in firsts:
        pairs = [mean_n[i], slope_n[i], mean_n[i + 1], slope_n[i + 1]]
        found.append(_largest(_TO_CUBIC @ np.array(pairs)))
    return max(found) if found else float(np.max(ends))


def _largest(cubic: np.ndarray) -> float:
    """Largest value of c0 + c1 x + c2 x^2 + c3 x^3 on [-1, 1]."""
    c0, c1, c2, c3 = cubic.tolist()
    places = [-1.0, 1.0]
    inner = c2 * c2 - 3.0 * c1 * c3
    if inner > 0.0:  # both roots of c1 + 2 c2 x + 3 c3 x^2, each without cancellation
        sum_ = -c2 - math.copysign(math.sqrt(inner), c2)
        turning = [c1 / sum_ if sum_ else 0.0, sum_ / (3.0 * c3) if c3 else math.inf]
        places += [x for x in turning if abs(x) < 1.0]
    return max(c0 + x * (c1 + x * (c2 + x * c3)) for x in places)


def peak_speed_m_s(speed_m_s: np.ndarray) -> float:
    """Largest size of a speed that is known at the ends of steps, also between them: the vertex of
    the parabola through the three values around it."""
    size = np.abs(speed_m_s)
    at = int(np.argmax(size))
    if not 0 < at < len(size) - 1:
        return float(size[at])
    left, middle, right = np.sign(speed_m_s[at]) * speed_m_s[at - 1 : at + 2]
    bend = left - 2.0 * middle + right
    return float(middle - (right - left) ** 2 / (8.0 * bend)) if bend < 0.0 else float(size[at])
