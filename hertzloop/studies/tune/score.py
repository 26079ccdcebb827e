"""The metrics of settings over all scenes of a search, and the stability of their loops."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from hertzloop.results.touch_phases import Spread
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.evaluate import Pool, evaluate
from hertzloop.studies.cases.rows import metric_of
from hertzloop.studies.cases.touch_phases import at_all, spread_over
from hertzloop.studies.margin.growth import Growth, growth_of
from hertzloop.studies.tune.plan import TunePlan
from hertzloop.studies.tune.result import Candidate

PUBLISHED: dict[str, Any] = {
    "controller.law": "slope_threshold",
    "controller.kappa": 0.8,
    "controller.v_thr_m_s": -0.25,
}
NO_METRIC = 1e6  # stands for the metric of a case that is unstable or impossible


def worst_of(
    pool: Pool, plan: TunePlan, cases: list[dict[str, Any]], names: Sequence[str]
) -> np.ndarray:
    """Return the largest metrics of settings over the scenes.

    Args:
        pool: Runs cases.
        plan: The scenes, the span, and the number of touch phases; of several, the mean counts.
        cases: Settings: values by scene key.
        names: Names of the metrics.

    Returns:
        Shape (cases, names), in the units of the metrics; `NO_METRIC` where there is none.
    """

    def metric(row: dict[str, Any], name: str) -> float:
        value = metric_of(row, name)
        return NO_METRIC if math.isnan(value) else value

    scenes, span, phases = plan.variants, plan.request.span, plan.request.phases
    tried = cases if phases == 1 else [c for case in cases for c in at_all(case, phases)]
    found = np.array(
        [
            [[metric(row, name) for name in names] for row in evaluate(pool, setup, span, tried)]
            for setup in scenes
        ]
    ).reshape(len(scenes), len(cases), phases, len(names))
    means = np.where((found >= NO_METRIC).any(axis=2), NO_METRIC, found.mean(axis=2))
    return np.asarray(means.max(axis=0))


def unstable_loop(scenes: Sequence[Setup], values: dict[str, Any]) -> Growth | None:
    """Return the fastest growth of an unstable linear loop over the scenes under a setting; None
    where every loop is stable in flight, or is not linear."""
    found = []
    for setup in scenes:
        with suppress(SceneError):  # a setting that a scene refuses has no metrics either
            growth = growth_of(setup.vary(values))
            if growth is not None and growth.unstable_poles != 0:
                found.append(growth)
    return max(found, key=lambda g: math.inf if g.per_s is None else g.per_s, default=None)


def with_spreads(pool: Pool, plan: TunePlan, found: list[Candidate]) -> list[Candidate]:
    """Return the same settings with mean and range of their metrics over the touch phase."""
    cases, names = [f.values for f in found], tuple(plan.request.minimise)
    tried = [spread_over(pool, setup, plan.request.span, cases, names) for setup in plan.variants]

    def worst(i: int, name: str) -> Spread:
        return max((spreads[i][name] for spreads in tried), key=lambda s: s.mean)

    return [replace(f, spreads={n: worst(i, n) for n in names}) for i, f in enumerate(found)]


def published_setting(pool: Pool, plan: TunePlan) -> Candidate:
    """Return the published setting of the slope-threshold law in the same scenes; its metrics are
    nan where a scene refuses it, or its loop is unstable."""
    names = plan.request.minimise
    worst = worst_of(pool, plan, [PUBLISHED], names)[0]
    metrics = (math.nan if value >= NO_METRIC else float(value) for value in worst)
    return Candidate(PUBLISHED, dict(zip(names, metrics, strict=True)))
