"""Count the simulations of a fit, and estimate how many there will be."""

from collections.abc import Callable
from dataclasses import dataclass

_STEPS_OF_STAGE = 4  # expected steps of a minimisation


@dataclass
class SimulationCounter:
    """Simulations of a fit, with all of its problems.

    Attributes:
        on_progress: is called with the simulations done and expected after each one.
        done: number of simulations so far.
        expected: number of simulations of the whole fit.
    """

    on_progress: Callable[[int, int], None] = lambda done, expected: None
    done: int = 0
    expected: int = 0

    def add(self, simulations: int) -> None:
        """Count simulations."""
        self.done += simulations
        if simulations:
            self.on_progress(self.done, max(self.expected, self.done + 1))

    def expect(self, stages: int, keys: int) -> None:
        """Expect a number of further minimisations of a problem with some keys."""
        self.expected = self.done + _STEPS_OF_STAGE * stages * (2 * keys + 2)
