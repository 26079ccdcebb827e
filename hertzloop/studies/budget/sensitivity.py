"""Which uncertain keys the metrics of the goals depend on: Sobol indices by SALib.

A. Saltelli et al., Comput. Phys. Commun. 181 (2010) 259.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.goal import Goal
from hertzloop.studies.cases.rows import Rows, RunCases, metric_of
from hertzloop.studies.cases.uncertain import UncertainInput, UncertainInputs


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
    setup: Setup, goals: Sequence[Goal], inputs: UncertainInputs, base: int, run: RunCases
) -> list[Sensitivity]:
    """Return the Sobol indices of the metrics of the goals. See `sobol_indices`."""

    names = list(dict.fromkeys(goal.metric for goal in goals))

    def metrics_at(points: list[list[float]]) -> Rows:
        rows = run([inputs.at(point) for point in points])
        return [{name: metric_of(row, name) for name in names} for row in rows]

    return sobol_indices(inputs.parts, names, base, metrics_at, setup.seed)
