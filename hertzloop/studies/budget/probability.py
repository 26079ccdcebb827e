"""How likely a law meets its goals when scene keys are not known exactly.

The probability has a Wilson interval (E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209);
sensitivities are Sobol indices by SALib (A. Saltelli et al., Comput. Phys. Commun. 181 (2010) 259).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

from hertzloop.results.cases import CaseState
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.goal import METRICS, Goal, all_met, worst_excess
from hertzloop.studies.cases.evaluate import Case, Rows, Run
from hertzloop.studies.cases.uncertain import UncertainInput, UncertainInputs

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
    run: Run,
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
        SceneError: a case cannot be run.
    """
    rows: Rows = []
    drawn: list[Case] = []
    holds: list[bool] = []  # by case, whether its linear loop is stable
    wanted = min(FIRST, draws.most)
    while True:
        new = [draws.inputs.draw(setup.seed, number) for number in range(len(drawn), wanted)]
        drawn += new
        new_rows = run(new)
        rows += new_rows
        for row in new_rows:
            if row["state"] == CaseState.NOT_RUN:
                values = ", ".join(f"{key} = {row[key]:.6g}" for key in drawn[0])
                raise SceneError(f"the case with {values} cannot be run: {row['status']}")
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
        worst_metrics={name: math.nan if worst[name] is None else worst[name] for name in METRICS},
        drawn=tuple(drawn),
    )


def _quantiles(rows: Rows, metric: str) -> dict[float, float]:
    known = [row[metric] for row in rows if row[metric] is not None and row[metric] == row[metric]]
    if not known:
        return dict.fromkeys(QUANTILES, math.nan)
    return {q: float(np.quantile(known, q)) for q in QUANTILES}


@dataclass(frozen=True)
class Sensitivity:
    """Sobol indices of one uncertain part on one metric, each with half its 95 % interval.
    Correlated keys count as one part."""

    keys: tuple[str, ...]
    metric: str
    first: float
    first_half: float
    total: float
    total_half: float


def sobol_indices(
    parts: Sequence[UncertainInput],
    metrics: Sequence[str],
    base: int,
    run: Callable[[list[list[float]]], Sequence[Mapping[str, float]]],
    seed: int = 1,
) -> list[Sensitivity]:
    """Return first-order and total Sobol indices.

    Args:
        parts: The uncertain parts.
        metrics: Names of the metrics.
        base: Number of base points, a power of 2; base * (parts + 2) points are run.
        run: Returns the metrics at points of the unit cube, shape (points, keys).
        seed: Of the points and of the bootstrap that gives the intervals.

    Raises:
        ModuleNotFoundError: SALib is not installed.
        SceneError: a metric is missing at a point.
    """
    from SALib.analyze import sobol
    from SALib.sample import sobol as sampling

    names = [key for part in parts for key in part.keys]
    groups = [str(number) for number, part in enumerate(parts) for _ in part.keys]
    problem: dict[str, Any] = {
        "num_vars": len(names),
        "names": names,
        "bounds": [[0.0, 1.0]] * len(names),
    }
    if len(parts) < len(names):
        problem["groups"] = groups
    points = sampling.sample(problem, base, calc_second_order=False, seed=seed)
    inside = np.clip(points, 1e-15, 1.0 - 1e-15)
    rows = run([[float(x) for x in point] for point in inside])
    found = []
    for metric in metrics:
        values = np.array([row[metric] for row in rows], dtype=float)
        if not np.isfinite(values).all():
            raise SceneError(
                f"{metric}: is missing in {np.count_nonzero(~np.isfinite(values))} cases, as their "
                "loop is unstable. Narrow the distributions to get Sobol indices"
            )
        if np.ptp(values) == 0.0:
            found += [Sensitivity(part.keys, metric, 0.0, 0.0, 0.0, 0.0) for part in parts]
            continue
        got = sobol.analyze(
            problem, values, calc_second_order=False, seed=seed, print_to_console=False
        )
        for number, part in enumerate(parts):
            numbers = (float(got[name][number]) for name in ("S1", "S1_conf", "ST", "ST_conf"))
            found.append(Sensitivity(part.keys, metric, *numbers))
    return found


def sensitivities(
    setup: Setup, goals: Sequence[Goal], draws: Draws, base: int, run: Run
) -> list[Sensitivity]:
    """Return the Sobol indices of the metrics of the goals. See `sobol_indices`."""

    def metrics_at(points: list[list[float]]) -> Rows:
        rows = run([draws.inputs.at(point) for point in points])
        return [
            {name: math.nan if row[name] is None else row[name] for name in METRICS} for row in rows
        ]

    names = list(dict.fromkeys(goal.metric for goal in goals))
    return sobol_indices(draws.inputs.parts, names, base, metrics_at, setup.seed)
