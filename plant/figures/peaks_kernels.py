"""Compiled searches for the largest value of one contact, also between what is known."""

import math

import numpy as np

from jit import kernel
from plant.figures.rows_kernels import fastest

_WHOLE = 4  # steps that a contact has at least, for two whole ones beside each other


@kernel(inline=True)
def _highest(mean, slope):
    """Largest F_0, its index, largest end of the steps' lines, and whether there are slopes."""
    at, top, sloped = 0, -math.inf, False
    for i in range(mean.size):
        if math.isnan(mean[i]):
            return math.nan, i, math.nan, True
        if mean[i] > mean[at]:
            at = i
        end = mean[i] + abs(slope[i])
        top = end if end > top or math.isnan(end) else top
        sloped = sloped or slope[i] != 0.0
    return mean[at], at, top, sloped


@kernel(inline=True)
def _at(c0, c1, c2, c3, x):
    return c0 + x * (c1 + x * (c2 + x * c3))


@kernel(inline=True)
def _largest(c0, c1, c2, c3):
    """Largest value of c0 + c1 x + c2 x^2 + c3 x^3 on [-1, 1]."""
    most = max(_at(c0, c1, c2, c3, -1.0), _at(c0, c1, c2, c3, 1.0))
    inner = c2 * c2 - 3.0 * c1 * c3
    if inner > 0.0:  # both roots of c1 + 2 c2 x + 3 c3 x^2, each without cancellation
        sum_ = -c2 - math.copysign(math.sqrt(inner), c2)
        one = c1 / sum_ if sum_ != 0.0 else 0.0
        other = sum_ / (3.0 * c3) if c3 != 0.0 else math.inf
        if abs(one) < 1.0:
            most = max(most, _at(c0, c1, c2, c3, one))
        if abs(other) < 1.0:
            most = max(most, _at(c0, c1, c2, c3, other))
    return most


@kernel
def peak_force(mean, slope, to_cubic):
    """See plant.figures.peaks.peak_force_n; `to_cubic`: coefficients from F_0, F_1 of two steps
    beside each other, shape (4, 4)."""
    highest, at, top, sloped = _highest(mean, slope)
    if not sloped or math.isnan(highest):
        return highest
    if mean.size < _WHOLE:
        return top
    most = -math.inf
    c = np.empty(4)
    for i in range(max(at - 1, 1), min(at, mean.size - 3) + 1):
        for row in range(4):
            c[row] = (
                to_cubic[row, 0] * mean[i] + to_cubic[row, 1] * slope[i]
                + to_cubic[row, 2] * mean[i + 1] + to_cubic[row, 3] * slope[i + 1]
            )  # fmt: skip
        most = max(most, _largest(c[0], c[1], c[2], c[3]))
    return most if most > -math.inf else top


@kernel
def peak_size(values):
    """See plant.figures.peaks.peak_speed_m_s."""
    at = fastest(values)
    size = abs(values[at])
    if not 0 < at < values.size - 1:
        return size
    sign = math.copysign(1.0, values[at])
    left, middle, right = sign * values[at - 1], sign * values[at], sign * values[at + 1]
    bend = left - 2.0 * middle + right
    return middle - (right - left) ** 2 / (8.0 * bend) if bend < 0.0 else size
