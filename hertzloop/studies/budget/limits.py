"""A limit: up to which value of a quantity a law meets its goals, and what decides that.

Four things decide: runs that miss a goal, values that the scene refuses, runs that fail
(`limit_search.py`), and a linear loop in flight that is unstable (`stability.py`).
`plant_limits.py` asks them in this order, and `Boundary` tells which one it was.
"""

from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any

from hertzloop.common import readable

LEAST = ("bits", "bandwidth_hz")  # a law tolerates these down to a value, others up to one


class Boundary(StrEnum):
    """What decided a limit."""

    FOUND = "found"
    NO_LIMIT = "no limit"  # the goals are met up to the physical end of the quantity
    REFUSED = "refused"  # the goals are met up to the first value that the scene refuses
    FAILED = "failed"  # the goals are met up to the first value at which a case fails in its run
    NEVER = "never met"  # the most harmless value misses a goal
    IDEAL_ONLY = "ideal only"  # no finite value meets the goals
    IMPOSSIBLE = "not possible"  # the scene refuses the quantity
    STABILITY = "stability"  # beyond the value the linear loop is unstable; see `stability.py`
    UNSTABLE = "none (unstable loop)"  # the linear loop is unstable at the first value


@dataclass(frozen=True)
class BudgetLimit:
    """Up to where a law meets its goals.

    `value`: the last value that does, None where no limit was found; `first_failure`: the next
    value of the list, which misses a goal or fails; `searched`: least and largest value that the
    search reached; `interval`: whether every scanned value beyond the limit misses a goal;
    `holds_again`: those that do; `share`: the part of the searched list between the scene's own
    value and the boundary, negative where the scene is beyond it; `reason`: why there is no limit,
    why the scene refuses values, or why a case failed; `remark`: what a table says behind the
    value; `impact_alone`: what the search found, where the stability of the linear loop allows
    less, else None. Values are in `unit`.
    """

    quantity: str
    key: str
    unit: str
    boundary: Boundary
    value: float | None
    first_failure: float | None
    searched: tuple[float, float]
    interval: bool
    holds_again: tuple[float, ...]
    share: float | None
    cases: int
    reason: str = ""
    remark: str = ""
    impact_alone: "BudgetLimit | None" = None

    def words(self) -> str:
        """Return the limit in words, for a cell of a table."""
        if self.value is None:
            return self.boundary.value
        words = "at least" if self.quantity in LEAST else "up to"
        remark = f" ({self.remark})" if self.remark else ""
        return f"{words} {readable.quantity(self.value, self.unit, 4)}{remark}"

    def as_data(self) -> dict[str, Any]:
        """Return the limit as plain data."""
        data = asdict(self)
        del data["quantity"]
        return data | {
            "boundary": self.boundary.value,
            "searched": list(self.searched),
            "holds_again": list(self.holds_again),
            "impact_alone": self.impact_alone.as_data() if self.impact_alone else None,
        }


@dataclass(frozen=True)
class BudgetQuantity:
    """A quantity whose limit is asked for.

    `values`: from harmless to harsh, as the scene key takes them, up to the physical end; `end`:
    what the last value means, in a sentence; `usual`: place of the last value that the scan tries
    before it goes on to the end, None for all; `scale`: reported value over value of the key;
    `own`: place in the list of the scene's own value; `by_chance`: whether the effect depends on
    the seed; `finer`: the scan has so many times `SearchEffort.points` values, where the tolerated
    values often have gaps; `scan`: places of a scan in all variants, as for bits and sampling
    periods, which are few and have more gaps; evenly spread places if empty.
    """

    name: str
    key: str
    unit: str
    values: tuple[Any, ...]
    end: str = ""
    usual: int | None = None
    own: int = 0
    scale: float = 1.0
    by_chance: bool = False
    finer: int = 1
    scan: tuple[int, ...] = ()

    def reported(self, place: int) -> float | None:
        """Return a value in the unit of the report; None for an ideal part."""
        value = self.values[place]
        return None if isinstance(value, str) else float(f"{value * self.scale:.12g}")

    def within(self, limit: BudgetLimit) -> "BudgetQuantity":
        """Return the quantity with those values only that the search of a limit went through."""
        places = range(len(self.values))
        last = max(place for place in places if self.reported(place) in limit.searched)
        return replace(self, values=self.values[: last + 1], usual=None)
