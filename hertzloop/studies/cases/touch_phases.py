"""Metrics over the phase of the first touch within a sample, which nobody controls.

A law that counts samples answers as on a staircase with one step a sample, so a metric at one
phase tells one of two values. Mean and range are taken over phases spread evenly.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from hertzloop.results.spans import Span
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.evaluate import Pool, evaluate
from hertzloop.studies.cases.rows import Rows, metric_of

TOUCH_PHASE_KEY = "run.touch_phase"
_FEW = 5


def phases(count: int = _FEW) -> tuple[float, ...]:
    """Return phases spread evenly over a step; an odd number of them includes the middle."""
    return tuple(round((i + 0.5) / count, 6) for i in range(count))


@dataclass(frozen=True)
class Spread:
    """Mean, least and largest value of a metric; nan if a phase has none."""

    mean: float
    least: float
    most: float

    def __str__(self) -> str:
        return f"{self.mean:z.2f} ({self.least:z.2f} to {self.most:z.2f})"


def spread_of(values: Any) -> Spread:
    """Return the spread of the values of a metric over the phases."""
    found = np.asarray(values, dtype=float)
    with np.errstate(invalid="ignore"):
        return Spread(float(np.mean(found)), float(np.min(found)), float(np.max(found)))


def at_all(case: dict[str, Any], count: int = _FEW) -> list[dict[str, Any]]:
    """Return a case at every phase."""
    return [case | {TOUCH_PHASE_KEY: phase} for phase in phases(count)]


def spread_over(
    pool: Pool, setup: Setup, span: Span, cases: list[dict[str, Any]], metrics: tuple[str, ...]
) -> list[dict[str, Spread]]:
    """Return the spread of some metrics, one dictionary for each case."""
    rows = evaluate(pool, setup, span, [c for case in cases for c in at_all(case)])
    groups = [rows[i : i + _FEW] for i in range(0, len(rows), _FEW)]
    return [_spreads(group, metrics) for group in groups]


def _spreads(rows: Rows, metrics: tuple[str, ...]) -> dict[str, Spread]:
    return {name: spread_of([metric_of(row, name) for row in rows]) for name in metrics}


def grouped(rows: Rows, keys: list[str], metrics: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return one dictionary for all rows that differ in their phase only: the other `keys`, and the
    spread of `metrics`, in the order of the rows."""
    others = [key for key in keys if key != TOUCH_PHASE_KEY]
    found: dict[str, Rows] = {}
    for row in rows:
        found.setdefault(repr([row[key] for key in others]), []).append(row)
    return [
        {key: group[0][key] for key in others} | _spreads(group, metrics)
        for group in found.values()
    ]
