"""Derivatives of readings by finite differences."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hertzloop.identification.fit.loop_model import LoopModel
from hertzloop.identification.fit.model import FrozenModel

_KEY = 1e-4  # step of the logarithm of a key, without a law
_KEY_LOOP = 2e-3  # the same under a law
_KEY_ROUNDED = 3e-2  # the same under a law whose converters round
_PHASE = 0.04  # step of a phase, in periods
_JUMP = 4.0  # ratio of the derivatives on both sides from which the law decides otherwise on one


class DifferenceStep(NamedTuple):
    """A step for a derivative.

    Attributes:
        parameter: number of the parameter.
        size: of the step.
        bounds: of the parameter.
        looped: whether a law may decide otherwise on one side.
    """

    parameter: int
    size: float
    bounds: tuple[float, float]
    looped: bool

    def derivative(self, readings: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
        """Return the derivative of readings, (samples,): a central difference, one-sided at a bound
        and where the law decides otherwise on one side."""
        j = self.parameter
        up, down = x.copy(), x.copy()
        up[j] = min(x[j] + self.size, self.bounds[1])
        down[j] = max(x[j] - self.size, self.bounds[0])
        one, other = readings(up), readings(down)
        if self.looped and up[j] > x[j] > down[j]:
            middle = readings(x)
            sides = (one - middle) / (up[j] - x[j]), (middle - other) / (x[j] - down[j])
            sizes = [float(side @ side) for side in sides]
            if max(sizes) > _JUMP**2 * min(sizes):
                return sides[int(np.argmin(sizes))]
        return np.asarray((one - other) / (up[j] - down[j]))


def key_step(parameter: int, bounds: tuple[float, float], model: FrozenModel) -> DifferenceStep:
    """Return the step of a key's logarithm between bounds."""
    if not isinstance(model, LoopModel):
        return DifferenceStep(parameter, _KEY, bounds, False)
    return DifferenceStep(parameter, _KEY_ROUNDED if model.converts else _KEY_LOOP, bounds, True)


def phase_step(parameter: int, period: float) -> DifferenceStep:
    """Return the step of a phase, whose period is given in steps of the simulation."""
    return DifferenceStep(parameter, _PHASE * period, (-math.inf, math.inf), True)
