"""Rows of cases: what they hold, and which of them have a metric, were refused or failed."""

import math
from collections.abc import Callable
from typing import Any

from hertzloop.results.cases import SHOWN, CaseFailed, CaseState
from hertzloop.scene.errors import SceneError

Case = dict[str, Any]  # values by scene key
Row = dict[str, Any]  # of a case: see `run_cases`
Rows = list[Row]
RunCases = Callable[[list[Case]], Rows]  # rows of cases, in their order


def metric_of(row: Row, metric: str) -> float:
    """Return a metric of a case; nan without one."""
    value: float | None = row[metric]
    return math.nan if value is None else value


def with_metric(rows: Rows, metric: str) -> Rows:
    """Return the rows that have a metric."""
    return [row for row in rows if not math.isnan(metric_of(row, metric))]


def with_equal(rows: Rows, keys: list[str]) -> list[Rows]:
    """Return the rows that agree in some keys, each together, in the order of the rows."""
    found: dict[str, Rows] = {}
    for row in rows:
        found.setdefault(repr([row[key] for key in keys]), []).append(row)
    return list(found.values())


def metrics_with_values(rows: Rows) -> list[str]:
    """Return the metrics that are shown of some cases: those that a case has. A rebound that is
    zero without control has no share of that, so its height is shown."""
    names = [name for name in SHOWN if with_metric(rows, name)]
    if names and "rebound_percent" not in names and with_metric(rows, "rebound_height_mm"):
        names.insert(1, "rebound_height_mm")
    return names


def without_result(rows: Rows) -> Rows:
    """Return the rows of cases that were refused or failed. An unstable case has a result."""
    return [row for row in rows if row["state"] in (CaseState.NOT_RUN, CaseState.FAILED)]


def failed(rows: Rows) -> Rows:
    """Return the rows of cases that failed in their run."""
    return [row for row in rows if row["state"] == CaseState.FAILED]


def check_all_ran(rows: Rows, lead: str) -> None:
    """Refuse cases without a result.

    Args:
        rows: The rows of the cases.
        lead: What an error begins with, before the reason of the case.

    Raises:
        CaseFailed: a case failed in its run.
        SceneError: a case was refused.
    """
    for row in without_result(rows):
        kind = CaseFailed if failed([row]) else SceneError
        raise kind(f"{lead}: {row['status']}")
