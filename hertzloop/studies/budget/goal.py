"""Goals of a law: a metric of a case, a relation, and a limit."""

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from hertzloop.results.cases import CaseMetrics
from hertzloop.scene.errors import SceneError, shown

DEFAULT_GOAL = "plate_energy_db <= -0.1"
# Metrics of a case that are numbers, in the order in which a case has them.
METRICS = tuple(f.name for f in fields(CaseMetrics) if f.type in (float, int))
_FORM = re.compile(r"\s*([a-z_]+)\s*(<=|>=|<|>)\s*([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*")
_SIGN = {"<=": 1.0, "<": 1.0, ">=": -1.0, ">": -1.0}


class GoalError(SceneError):
    """A goal cannot be read. The message quotes it and shows the form of a goal."""


@dataclass(frozen=True)
class Goal:
    """A condition on one metric of a case, such as plate_energy_db <= -3.

    `metric`: a field of `CaseMetrics`, in its unit; `relation`: <=, <, >= or >; `limit`: in the
    unit of the metric.
    """

    metric: str
    relation: str
    limit: float

    def __str__(self) -> str:
        return f"{self.metric} {self.relation} {self.limit:.12g}"

    def excess(self, row: Mapping[str, Any]) -> float:
        """Return by how much a case misses the goal, in the unit of the metric.

        Args:
            row: A row as of `run_cases`.

        Returns:
            A negative number or zero where the goal is met with this margin; inf for a case that
            is unstable or lacks the metric.
        """
        value = row[self.metric]
        if row["status"] or value is None or math.isnan(value):
            return math.inf
        return _SIGN[self.relation] * (float(value) - self.limit)

    def met(self, row: Mapping[str, Any]) -> bool:
        """Return whether a case meets the goal."""
        excess = self.excess(row)
        return excess < 0.0 if self.relation in ("<", ">") else excess <= 0.0


def parse_goal(text: str) -> Goal:
    """Read a goal, for example 'plate_energy_db <= -3'.

    Raises:
        GoalError: the text is not a goal, or its metric is unknown.
    """
    found = _FORM.fullmatch(text)
    try:
        limit = float(found[3]) if found else math.nan
    except ValueError:
        limit = math.nan
    if not found or not math.isfinite(limit):
        raise GoalError(
            f"--goal = {shown(text)}: must be a metric, one of <=, <, >=, > and a number. "
            f"Write for example '{DEFAULT_GOAL}'"
        )
    if found[1] not in METRICS:
        near = difflib.get_close_matches(found[1], METRICS, 1)
        hint = f"Did you mean {near[0]}? " if near else ""
        raise GoalError(
            f"--goal = {shown(text)}: {found[1]} is not a metric. {hint}"
            f"Choose one of {', '.join(METRICS)}"
        )
    return Goal(found[1], found[2], limit)


def all_met(goals: Sequence[Goal], row: Mapping[str, Any]) -> bool:
    """Return whether a case meets all goals."""
    return all(goal.met(row) for goal in goals)


def worst_excess(goals: Sequence[Goal], row: Mapping[str, Any]) -> float:
    """Return the largest excess of a case over the goals, each relative to the size of its limit;
    it orders cases, and has no unit."""
    return max(goal.excess(row) / max(abs(goal.limit), 1e-12) for goal in goals)
