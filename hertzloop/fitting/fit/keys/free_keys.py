"""The scene keys that a fit varies."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hertzloop.fitting.fit.errors import FitError

_EARLY_SPREADS = 6.0  # the early windows know a key to a sixth of its range
_AT_BOUND = 1e-6  # of a logarithm
PRESSURE_KEY = "contact.limiting_pressure_pa"


@dataclass(frozen=True)
class FreeKey:
    """A free scene key, whose natural logarithm is fitted.

    Attributes:
        key: name of the key.
        start: starting value, in the unit of the key.
        low: lower bound.
        high: upper bound.
        prior: relative standard deviation of the prior around `start`; None without a prior.
        resolution: distance of the values of a key in whole steps; None of another key.
    """

    key: str
    start: float
    low: float
    high: float
    prior: float | None = None
    resolution: float | None = None

    @property
    def step(self) -> float:
        """Distance of the values of a key in whole steps, in its unit."""
        return self.resolution or 1.0

    @property
    def steps(self) -> range:
        """The values within the bounds of a key in whole steps, as numbers of steps."""
        first = math.ceil(self.low / self.step - 1e-9)
        return range(first, math.floor(self.high / self.step + 1e-9) + 1)

    @property
    def early_sd(self) -> float:
        """Standard deviation of the weak prior on the logarithm in early windows."""
        return math.log(self.high / self.low) / _EARLY_SPREADS

    def at_bound(self, logarithm: float) -> str:
        """At which end of the range the logarithm of a value is, "low" or "high"; "" within."""
        if logarithm <= math.log(self.low) + _AT_BOUND:
            return "low"
        return "high" if logarithm >= math.log(self.high) - _AT_BOUND else ""


def refuse_duplicates(free: Sequence[FreeKey]) -> None:
    """Raise FitError for a key that is given twice."""
    keys = [f.key for f in free]
    for key in keys:
        if keys.count(key) > 1:
            raise FitError(f"--free {key}: is given twice. Name each key once.")
