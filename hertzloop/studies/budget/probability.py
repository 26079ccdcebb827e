"""How likely a law meets its goals when scene keys are not known exactly.

The probability has a Wilson interval (E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

from hertzloop.results.cases import CaseState
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.goal import METRICS, Goal, all_met, worst_excess
from hertzloop.studies.cases.rows import (
    Case,
    Rows,
    RunCases,
    check_all_ran,
    metric_of,
    with_metric,
    without_result,
)
from hertzloop.studies.cases.uncertain import UncertainInputs

FIRST, CONFIDENCE, QUANTILES = 128, 0.95, (0.05, 0.25, 0.5, 0.75, 0.95)
_NORMAL = NormalDist()


def wilson(met: int, cases: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the Wilson interval of a probability.

    Args:
        met: Number of cases with success.
        cases: Number of all cases, at least 1.
        confidence: Probability with which the interval holds the true one.
    """
    z = _NORMAL.inv_cdf(0.5 + 0.5 * confidence)
    share, weight = met / cases, z * z / cases
    middle = (share + 0.5 * weight) / (1.0 + weight)
    half = z * math.sqrt(share * (1.0 - share) / cases + 0.25 * weight / cases) / (1.0 + weight)
    low = 0.0 if met == 0 else max(0.0, middle - half)
    return low, 1.0 if met == cases else min(1.0, middle + half)


@dataclass(frozen=True)
class Probability:
    """How likely the goals are met.

    Attributes:
        value: Share of the cases that meet the goals, with a stable linear loop.
        interval: Wilson interval of the probability, at `confidence`.
        confidence: Probability with which the interval holds the true one.
        cases: Number of cases.
        met: Number of cases that meet the goals.
        unstable: Number of cases whose loop is unstable, in the run or by linear theory.
        quantiles: Of every metric over the cases that have one, by probability.
        worst: Varied keys of the case that misses the goals by most, or is nearest to that.
        worst_metrics: Metrics of that case.
        drawn: Varied keys of every case, in order.
    """

    value: float
    interval: tuple[float, float]
    confidence: float
    cases: int
    met: int
    unstable: int
    quantiles: dict[str, dict[float, float]]
    worst: dict[str, Any]
    worst_metrics: dict[str, float]
    drawn: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class Draws:
    """What to draw, and how often.

    Attributes:
        inputs: The distributions.
        within: Half the width of the interval of the probability that is narrow enough.
        most: Number of cases after which to stop in any event.
    """

    inputs: UncertainInputs
    within: float = 0.05
    most: int = 4096


def probability(
    setup: Setup,
    goals: Sequence[Goal],
    draws: Draws,
    run: RunCases,
    stable: Callable[[Case], bool] = lambda case: True,
) -> Probability:
    """Draw cases until the interval of the probability is narrow enough.

    The number of cases doubles from 128 on. A first look at 64 stops too often at an interval that
    is narrow by chance: some probabilities are then in less than 93 % of the intervals.

    Args:
        setup: The scene.
        goals: All have to be met.
        draws: What to draw, and how often.
        run: Returns the rows of cases, in their order.
        stable: Whether the linear loop is stable in a case; a case that is not misses the goals.

    Raises:
        CaseFailed: a case failed in its run.
        SceneError: a case was refused.
    """
    rows: Rows = []
    drawn: list[Case] = []
    holds: list[bool] = []  # by case; false if the goals are met but the loop is unstable
    wanted = min(FIRST, draws.most)
    while True:
        new = [draws.inputs.draw(setup.run.seed, number) for number in range(len(drawn), wanted)]
        drawn += new
        new_rows = run(new)
        rows += new_rows
        for row in without_result(new_rows):
            values = ", ".join(f"{key} = {row[key]:.6g}" for key in drawn[0])
            check_all_ran([row], f"the case with {values} cannot be run")
        holds += [
            not all_met(goals, row) or stable(case) for row, case in zip(new_rows, new, strict=True)
        ]
        met = sum(all_met(goals, row) and holds[i] for i, row in enumerate(rows))
        interval = wilson(met, len(rows), CONFIDENCE)
        if 0.5 * (interval[1] - interval[0]) <= draws.within or len(rows) >= draws.most:
            break
        wanted = min(2 * len(rows), draws.most)
    excess = [worst_excess(goals, row) if holds[i] else math.inf for i, row in enumerate(rows)]
    worst = rows[excess.index(max(excess))]
    return Probability(
        value=met / len(rows),
        interval=interval,
        confidence=CONFIDENCE,
        cases=len(rows),
        met=met,
        unstable=sum(row["state"] == CaseState.UNSTABLE for row in rows) + holds.count(False),
        quantiles={name: _quantiles(rows, name) for name in METRICS},
        worst={key: worst[key] for key in drawn[0]},
        worst_metrics={name: metric_of(worst, name) for name in METRICS},
        drawn=tuple(drawn),
    )


def _quantiles(rows: Rows, metric: str) -> dict[float, float]:
    known = [row[metric] for row in with_metric(rows, metric)]
    if not known:
        return dict.fromkeys(QUANTILES, math.nan)
    return {q: float(np.quantile(known, q)) for q in QUANTILES}
