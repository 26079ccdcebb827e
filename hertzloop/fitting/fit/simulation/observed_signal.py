"""What the measuring chain makes of a quantity: filters on the fine grid, then the sample times."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from hertzloop.fitting.fit.simulation.measuring_chain import MeasuringChain
from hertzloop.fitting.fit.simulation.simulated_impact import SimulatedImpact

_FINER, _MOST_REFINED = 4, 30_000  # points of the filters' grid for a step; of at most so many


@dataclass(frozen=True)
class ObservedSignal:
    """A filtered quantity as a function of the time after the first touch."""

    simulated: SimulatedImpact
    quantity: str
    chain: MeasuringChain
    away_from_contact: bool
    spline: Any  # of the output over the fine grid

    def value(self, time_s: np.ndarray) -> np.ndarray:
        """Values at times after the touch, s; shape as `time_s`."""
        if self.chain.ideal:
            return self.simulated.value(self.quantity, time_s, self.away_from_contact)
        return self._of_spline(time_s, 0)

    def slope(self, time_s: np.ndarray) -> np.ndarray:
        """Derivative by time; shape as `time_s`."""
        if self.quantity in ("xi", "xi_s") and self.chain.ideal:
            h = 0.1 * self.simulated.step_s
            return (self.value(time_s + h) - self.value(time_s - h)) / (2.0 * h)
        return self._of_spline(time_s, 1)

    def _of_spline(self, time_s: np.ndarray, order: int) -> np.ndarray:
        grid = self.spline.x
        found = self.spline(np.clip(time_s, grid[0], grid[-1]), order)
        return np.asarray(np.where(time_s > grid[0], found, 0.0))


def observe(
    simulated: SimulatedImpact, quantity: str, chain: MeasuringChain, away_from_contact: bool
) -> ObservedSignal:
    """Return what a chain shows of a simulated drop."""
    grid_s = simulated.time_s
    if chain.before_s:
        more = math.ceil(chain.before_s / simulated.step_s)
        grid_s = grid_s[0] + np.arange(-more, len(grid_s)) * simulated.step_s
    if not chain.ideal and len(grid_s) <= _MOST_REFINED:
        # A filter is exact for straight lines between samples; a finer grid bends these less.
        n = _FINER * (len(grid_s) - 1) + 1
        grid_s = grid_s[0] + np.arange(n) * (simulated.step_s / _FINER)
    fine = simulated.value(quantity, grid_s, away_from_contact)
    if not chain.ideal:
        fine = chain.filtered(fine, float(grid_s[1] - grid_s[0]))
    spline = scipy.interpolate.CubicSpline(grid_s, fine)
    return ObservedSignal(simulated, quantity, chain, away_from_contact, spline)
