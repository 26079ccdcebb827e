"""Samples whose latencies matter to the first impact, and their division into blocks."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.rows import Row


@dataclass(frozen=True)
class LatencyWindow:
    """Samples whose latencies matter to the first impact: from `first` until `end`. Until `fine`
    there is contact, where single samples matter; later ones matter less and less."""

    first: int
    fine: int
    end: int

    @property
    def count(self) -> int:
        """Number of samples."""
        return self.end - self.first

    def blocks(self, count: int) -> list[tuple[int, int]]:
        """Return about `count` blocks, as first sample and end: of equal length in contact, and
        longer the later they are after it."""
        fine = self.fine - self.first
        after = np.arange(self.count - fine)
        weight = np.concatenate([np.ones(fine), fine / (fine + after)])
        reached = np.concatenate([[0.0], np.cumsum(weight)])
        edges = np.unique(np.searchsorted(reached, np.linspace(0.0, reached[-1], count + 1)))
        return [(self.first + int(a), self.first + int(b)) for a, b in pairwise(edges)]


def window_of(setup: Setup, most_steps: int, nominal: Row) -> LatencyWindow:
    """Return the samples whose latencies matter to the first impact.

    Args:
        setup: The scene.
        most_steps: Largest additional latency, steps: a command before the touch may be that late.
        nominal: The row of the case without additional latency.
    """
    every = setup.scene.sensors.every_steps
    touch = round(setup.first_touch_s / setup.step_s)
    latency = round(setup.scene.controller.latency_us * 1000 / setup.step_ns)
    contact = round((nominal["contact_us"] or 0.0) * 1000 / setup.step_ns)
    first = max(0, touch - latency - most_steps - 1) // every
    fine = max(first + 1, -(-(touch + contact) // every))
    return LatencyWindow(first, fine, max(fine, -(-(nominal["steps"] or setup.steps) // every)))
