"""Derivatives of readings by finite differences."""

from collections.abc import Callable

import numpy as np

_JUMP = 4.0  # ratio of the derivatives on both sides from which the law decides otherwise on one


def derivative(
    readings: Callable[[np.ndarray], np.ndarray],
    x: np.ndarray,
    j: int,
    step: float,
    bounds: tuple[float, float],
    looped: bool,
) -> np.ndarray:
    """Return the derivative of readings, (samples,): a central difference, one-sided at a bound.

    Args:
        readings: as a function of the parameters.
        x: parameters.
        j: number of the parameter.
        step: of the parameter.
        bounds: of the parameter.
        looped: whether a law may decide otherwise on one side; then the other side is used.
    """
    up, down = x.copy(), x.copy()
    up[j] = min(x[j] + step, bounds[1])
    down[j] = max(x[j] - step, bounds[0])
    one, other = readings(up), readings(down)
    if looped and up[j] > x[j] > down[j]:
        middle = readings(x)
        sides = (one - middle) / (up[j] - x[j]), (middle - other) / (x[j] - down[j])
        sizes = [float(side @ side) for side in sides]
        if max(sizes) > _JUMP**2 * min(sizes):
            return sides[int(np.argmin(sizes))]
    return np.asarray((one - other) / (up[j] - down[j]))
