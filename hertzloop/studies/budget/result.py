"""The result of a budget: what a law does in each plant, and its limits there."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from hertzloop.results.spans import Span
from hertzloop.results.touch_phases import Spread
from hertzloop.studies.budget.goal import Goal
from hertzloop.studies.budget.limits import BudgetLimit
from hertzloop.studies.budget.probability import Probability
from hertzloop.studies.margin.flight import Margin


@dataclass(frozen=True)
class Baseline:
    """What a law does in a scene as it is: metrics against no control at the scene's own touch
    phase, their spread over phases, whether the goals are met at every phase, and whether the loop
    was unstable at one of them."""

    metrics: dict[str, float]
    over_phases: dict[str, Spread]
    met: bool
    unstable: bool
    missed: tuple[str, ...]


@dataclass(frozen=True)
class InPlant:
    """Effect by metrics of a span, and limits, in one plant; `margin`: the linear margin, None for
    a law that has none; `binds_first`: the quantity whose limit is the nearest, by
    `BudgetLimit.share`, None where no limit was found; `deepest_m`: the largest elastic penetration
    without control, None where the law senses another quantity; `left_out`: keys of the real plant
    that the scene does not accept."""

    span: Span
    nominal: Baseline
    margin: Margin | None
    limits: tuple[BudgetLimit, ...]
    binds_first: str | None
    deepest_m: float | None = None
    left_out: tuple[str, ...] = ()

    @property
    def unstable(self) -> bool | None:
        """Whether the loop is unstable, in a run or by linear theory; None if unknown."""
        if self.nominal.unstable:
            return True
        stable = None if self.margin is None else self.margin.stable
        return None if stable is None else not stable


@dataclass(frozen=True)
class BudgetResult:
    """The budget of a law in a scene.

    Attributes:
        scene: Name of the scene.
        law: Name or file of the law.
        span: Part of the run whose metrics come first.
        goals: What the law has to do, all of it.
        ideal: Effect and limits in the scene.
        real: The same in the real plant; None if it was not asked for.
        other: The same as `ideal` by metrics of the other span; None if it was not asked for.
        other_db: Change of the plate energy over the other span, dB; None without one, and
            where later impacts are not predictable: `why_no_other` says why, in a sentence.
        probability: How likely the goals are met with uncertain keys, if asked for.
        cases: Number of cases that the limits took.
        all_cases: Number of all cases.
        failed: The reason of each case that failed in its run.
    """

    scene: str
    law: str
    span: Span
    goals: tuple[Goal, ...]
    ideal: InPlant
    real: InPlant | None
    other: InPlant | None
    other_db: float | None
    why_no_other: str
    probability: Probability | None
    cases: int
    all_cases: int
    failed: tuple[str, ...] = ()

    def as_data(self) -> dict[str, Any]:
        """Return the result as the data of `--json`; `probability` lacks the command that repeats
        its worst case."""
        ideal, real = self.ideal, self.real
        return {
            "scene": self.scene,
            "law": self.law,
            "span": self.span,
            "goal": " and ".join(map(str, self.goals)),
            "goals": [asdict(goal) for goal in self.goals],
            "met": ideal.nominal.met,
            "missed": list(ideal.nominal.missed),
            "nominal": ideal.nominal.metrics,
            "nominal_over_phases": _spreads(ideal.nominal),
            "limits": _limits(ideal),
            "binds_first": ideal.binds_first,
            "other_span_db": self.other_db,
            "other_span": _limits(self.other) if self.other else None,
            "real_plant": _limits(real) if real else None,
            "real_plant_met": real.nominal.met if real else None,
            "real_plant_nominal": real.nominal.metrics if real else None,
            "real_plant_over_phases": _spreads(real.nominal) if real else None,
            "real_plant_binds_first": real.binds_first if real else None,
            "real_plant_left_out": list(real.left_out) if real else None,
            "real_plant_linear_margin": _margin(real.margin) if real else None,
            "real_plant_unstable": real.unstable if real else None,
            "linear_margin": _margin(ideal.margin),
            "unstable": ideal.unstable,
            "probability": asdict(self.probability) if self.probability else None,
            "cases": self.cases,
        }


def nearest(limits: Iterable[BudgetLimit]) -> list[BudgetLimit]:
    """Return the limits that were found, those with the least share of their searched range left
    before them first."""
    found = [limit for limit in limits if limit.share is not None]
    return sorted(found, key=lambda limit: limit.share or 0.0)


def _limits(plant: InPlant) -> dict[str, Any]:
    return {limit.quantity: limit.as_data() for limit in plant.limits}


def _spreads(nominal: Baseline) -> dict[str, dict[str, float]]:
    return {name: asdict(spread) for name, spread in nominal.over_phases.items()}


def _margin(margin: Margin | None) -> dict[str, Any] | None:
    return None if margin is None else asdict(margin)
