"""Times of several cases, measured in turn.

Machines are shared and noisy. All cases are measured round after round, so that other work on the
machine meets all of them, and each is set against a yardstick, the first case.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.program import tracked


@dataclass(frozen=True)
class Cost:
    """Median and smallest time of one case over all rounds, and the ratio of the medians to the
    first case."""

    case: str
    median_us: float
    least_us: float
    ratio: float


def in_turn(cases: dict[str, Callable[[], float]], rounds: int) -> list[Cost]:
    """Measure every case once a round; each returns microseconds per unit."""
    for measure in cases.values():
        measure()  # loads what is compiled
    found: dict[str, list[float]] = {name: [] for name in cases}
    for _ in tracked("rounds", range(rounds)):
        for name, measure in cases.items():
            found[name].append(measure())
    medians = {name: statistics.median(values) for name, values in found.items()}
    first = next(iter(medians.values()))
    return [Cost(name, medians[name], min(found[name]), medians[name] / first) for name in cases]


def timed(work: Callable[[], object], units: int) -> float:
    """Microseconds of wall time that a piece of work takes, over its number of units."""
    started = time.perf_counter()
    work()
    return (time.perf_counter() - started) * 1e6 / units
