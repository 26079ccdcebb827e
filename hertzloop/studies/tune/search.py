"""The search for the best settings of one law.

One objective: differential evolution; several: NSGA-II (Deb et al. 2002), both from pymoo.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.algorithms.soo.nonconvex.de import DE
from pymoo.core.problem import Problem
from pymoo.optimize import minimize
from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

from hertzloop.studies.cases.axis import Axis, fitted
from hertzloop.studies.cases.evaluate import Pool
from hertzloop.studies.margin.growth import Growth
from hertzloop.studies.tune.plan import TunePlan
from hertzloop.studies.tune.result import Candidate
from hertzloop.studies.tune.score import NO_METRIC, unstable_loop, worst_of


def search_law(
    pool: Pool,
    plan: TunePlan,
    law: str,
    on_progress: Callable[[int], None] = lambda generation: None,
) -> list[Candidate]:
    """Return the best settings of one law: the best one, or the Pareto front of several metrics.

    Args:
        pool: Runs cases.
        plan: What to search.
        law: One of the laws of the plan.
        on_progress: Called with the number of finished generations.

    Returns:
        Sorted by the first metric; empty if no setting keeps to the limits or is stable.
    """
    search, names = plan.request, plan.request.minimise
    problem = _Settings(pool, plan, law)
    algorithm = (DE if len(names) == 1 else NSGA2)(pop_size=search.population)
    result = minimize(
        problem,
        algorithm,
        ("n_gen", search.generations),
        seed=search.seed,
        callback=lambda algorithm: on_progress(algorithm.n_gen),
    )
    if result.X is None:
        return []
    points, values = np.atleast_2d(result.X), np.atleast_2d(result.F)
    if len(names) > 1:  # the last generation lacks settings of the front that were found before
        points, values = problem.allowed()
    found = [
        Candidate(problem.settings(x), dict(zip(names, (float(v) for v in f), strict=True)))
        for x, f in zip(points, values, strict=True)
        if np.all(f < NO_METRIC)
    ]
    return front(found, names)


def front(found: list[Candidate], names: Sequence[str]) -> list[Candidate]:
    """Return the settings that no other beats in every metric, sorted by the first metric."""
    if not found:
        return []
    values = np.array([[f.metrics[name] for name in names] for f in found])
    best = NonDominatedSorting().do(values, only_non_dominated_front=True)
    unique = {tuple(values[i]): found[i] for i in best}
    return [unique[key] for key in sorted(unique)]


class _Settings(Problem):
    """Parameters of a law as an optimisation problem; all cases of a generation at once."""

    def __init__(self, pool: Pool, plan: TunePlan, law: str) -> None:
        self.pool, self.plan, self.fixed = pool, plan, {"controller.law": law}
        self._tried: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []  # x, F, G
        coarsest = max(plan.variants, key=lambda setup: setup.run.step_ns)
        # By the law that is tried: the scenes' own may not have its keys.
        of_law = coarsest.vary(self.fixed)
        self.axes = axes = tuple(fitted(axis, of_law) for axis in plan.axes[law])
        super().__init__(
            n_var=len(axes),
            n_obj=len(plan.request.minimise),
            n_ieq_constr=len(plan.request.at_most) + plan.request.require_stable,
            xl=[0.0 if axis.values else axis.low for axis in axes],
            xu=[len(axis.values) - 1e-9 if axis.values else axis.high for axis in axes],
        )

    def settings(self, x: np.ndarray) -> dict[str, Any]:
        """Return values by scene key at a point of the search."""
        pairs = zip(self.axes, x, strict=True)
        return self.fixed | {axis.key: _value(axis, float(v)) for axis, v in pairs}

    def _evaluate(self, x: np.ndarray, out: dict[str, Any], *_: Any, **__: Any) -> None:
        search, scenes = self.plan.request, self.plan.variants
        names, wanted = [*search.minimise, *search.at_most], len(search.minimise)
        cases = [self.settings(p) for p in x]
        growths = [unstable_loop(scenes, case) if search.require_stable else None for case in cases]
        stable = [i for i, growth in enumerate(growths) if growth is None]
        worst = np.full((len(cases), len(names)), NO_METRIC)
        if stable:
            worst[stable] = worst_of(self.pool, self.plan, [cases[i] for i in stable], names)
        out["F"] = worst[:, :wanted]
        excess = [worst[:, wanted:] - np.array(list(search.at_most.values()))]
        if search.require_stable:  # the growth leads the search to where there is none
            excess.append(np.array([[_growth_per_s(growth)] for growth in growths]))
        out["G"] = np.concatenate(excess, axis=1)
        self._tried.append((x.copy(), out["F"], out["G"]))

    def allowed(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the points that were tried and keep to the limits, shape (points, axes), and their
        metrics, shape (points, metrics)."""
        points, metrics, excess = (np.concatenate(part) for part in zip(*self._tried, strict=True))
        kept = np.all(excess <= 0.0, axis=1)
        return points[kept], metrics[kept]


def _value(axis: Axis, x: float) -> Any:
    """Return the value of a key at a coordinate of the search."""
    if axis.values:
        return axis.values[min(int(x), len(axis.values) - 1)]
    return axis.at_resolution(float(x))


def _growth_per_s(growth: Growth | None) -> float:
    """Growth of an unstable loop, 1/s; 0 of a stable one, and a large number if undecided."""
    if growth is None:
        return 0.0
    return NO_METRIC if growth.per_s is None else growth.per_s
