"""The result of `tune`."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hertzloop.results.spans import Span
from hertzloop.results.touch_phases import Spread
from hertzloop.studies.margin.growth import Growth


@dataclass(frozen=True)
class Candidate:
    """A setting and its metrics.

    Attributes:
        values: values by scene key.
        metrics: minimised metrics by name, the worst of the scenes.
        spreads: mean and range over touch phases by metric, for the scene with the worst mean;
            empty where not computed.
        unstable_loop: growth of the linear loop in flight; None if it is stable or not linear.
    """

    values: dict[str, Any]
    metrics: dict[str, float]
    spreads: dict[str, Spread] = field(default_factory=dict)
    unstable_loop: Growth | None = None

    def words(self) -> str:
        """Return the law and the numbers of the setting."""
        numbers = [
            f"{key.split('.')[-1]} {value:.4g}"
            for key, value in self.values.items()
            if isinstance(value, int | float)
        ]
        return f"{self.values['controller.law']}: {', '.join(numbers)}"


@dataclass(frozen=True)
class TuneResult:
    """What a search found, and what was asked for.

    Attributes:
        minimise: Names of the metrics.
        span: Part of the run that was evaluated.
        at_most: Largest allowed values, by metric.
        front: The settings that no other beats, the best first: those that do not raise the second
            metric above that of the published setting, then the others, each by the first metric.
        published: The published setting of the slope-threshold law, in the same scenes.
        failed: The reason of each case that could not be run.
        cases: Number of cases.
        ran: Number of cases that were not in the journal of an earlier start.
    """

    minimise: Sequence[str]
    span: Span
    at_most: Mapping[str, float]
    front: list[Candidate]
    published: Candidate
    failed: Sequence[str]
    cases: int
    ran: int

    @property
    def winner(self) -> Candidate | None:
        """The setting with the least first metric that does not raise the second one above that of
        the published setting; None if none improves on the published setting, or if that has no
        metrics."""
        gain, keep = self.minimise[0], self.minimise[min(1, len(self.minimise) - 1)]
        return better_than(self.published, self.front, gain, keep)

    @property
    def best(self) -> Candidate:
        """The first setting of the front, which is the winner if there is one."""
        return self.front[0]

    @property
    def verdict(self) -> str:
        """A sentence on how the best setting compares with the published one."""
        first, rest, winner, published = (
            self.minimise[0],
            self.minimise[1:],
            self.winner,
            self.published,
        )
        keep = rest[0] if rest else first
        if any(math.isnan(published.metrics[name]) for name in (first, keep)):
            return "the published setting has no metrics in these scenes, so none is compared to it"
        if winner is None:
            without = f" without raising {keep}" if rest else ""
            return f"none beats the published setting in {first}{without}"
        gained = published.metrics[first] - winner.metrics[first]
        sentence = f"{winner.words()} beats the published setting in {first} by {gained:z.3f}"
        if not rest:
            return sentence
        return (
            f"{sentence} at {keep} {winner.metrics[keep]:z.3f} against "
            f"{published.metrics[keep]:z.3f}"
        )


def best_first(front: Sequence[Candidate], published: Candidate) -> list[Candidate]:
    """Return the settings of a front in the order of `TuneResult.front`."""
    gain, *others = front[0].metrics if front else ("",)
    keep = others[0] if others else gain

    def place(found: Candidate) -> tuple[bool, float]:
        return not found.metrics[keep] <= published.metrics[keep], found.metrics[gain]

    return sorted(front, key=place)


def better_than(
    reference: Candidate, found: Sequence[Candidate], gain: str, keep: str
) -> Candidate | None:
    """Return the setting with the least `gain` among those that do not raise `keep`; None if none
    has less than the reference."""
    allowed = [f for f in found if f.metrics[keep] <= reference.metrics[keep]]
    best = min(allowed, key=lambda f: f.metrics[gain], default=None)
    return best if best and best.metrics[gain] < reference.metrics[gain] else None
