"""The result of a sweep, and what its rows tell together."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

from hertzloop.results.cases import CaseState
from hertzloop.studies.cases.rows import Rows, without_result


@dataclass(frozen=True)
class SweepResult:
    """What a sweep found.

    Attributes:
        rows: Varied keys and metrics of each case, in the order of the cases.
        ran: Number of cases that were run now, and not in an earlier start.
        wall_s: Wall time of these, s.
        damaged: Numbers of damaged lines of the journal, whose cases were run again.
    """

    rows: list[dict[str, Any]]
    ran: int
    wall_s: float
    damaged: list[int]

    @property
    def without_result(self) -> list[dict[str, Any]]:
        """Rows of cases that were refused or failed; `status` says why."""
        return without_result(self.rows)

    @property
    def growing(self) -> list[float]:
        """Growth of the linear loop, 1/s, in each case that has metrics although its loop is
        unstable; nan where undecided."""
        return [
            row["growth_per_s"]
            for row in self.rows
            if row["state"] == CaseState.METRICS and row["growth_per_s"]
        ]

    @property
    def unstable(self) -> int:
        """Number of cases that were run but have no metrics, since the loop explodes."""
        return sum(row["state"] == CaseState.UNSTABLE for row in self.rows)


def counted(rows: Rows, column: str) -> dict[str, int]:
    """Return how many cases have each of the names in a column of `CaseMetrics`."""
    names = (name for row in rows for name in (row[column] or "").split(", ") if name)
    return dict(Counter(names).most_common())
