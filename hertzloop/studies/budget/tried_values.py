"""What runs have shown of the values of a quantity, and which values to try next to be sure."""

from collections.abc import Generator, Iterable, Sequence

from hertzloop.studies.budget.effort import SearchEffort, lasting, variants
from hertzloop.studies.budget.goal import Goal, all_met, worst_excess
from hertzloop.studies.budget.limits import BudgetQuantity
from hertzloop.studies.cases.rows import Case, Rows, failed, without_result

_BELOW_JUMP = 8  # places below a jump, tried for a quantity that works by chance


class TriedValues:
    """What is known of the values of a quantity: the variants tried, and the values that fail."""

    def __init__(
        self, quantity: BudgetQuantity, goals: Sequence[Goal], effort: SearchEffort
    ) -> None:
        self.quantity, self.goals = quantity, goals
        self.order = variants(quantity, effort)
        self.phases = effort.phases
        self.lasts_s, self.long_s = effort.short_s, effort.long_s
        self.tried: dict[int, list[Case]] = {}
        self.failed: set[int] = set()
        self.excess: dict[int, float] = {}  # by place, the largest of the variants tried
        self.cases = 0
        self.reasons: dict[str, str] = {}  # why the first case was refused or failed, by state
        self.refused: set[int] = set()  # places of which the scene or the law refused a case
        self.broken: set[int] = set()  # places of which a case failed in its run

    def ask(self, places: Iterable[int]) -> Generator[list[Case], Rows, None]:
        """Try places in all variants: in one first, and in the others where that passes."""
        yield from self._try({place: self.order[:1] for place in places})
        yield from self._try({place: self.order for place in places})

    def glance(self, scan: Sequence[int]) -> Generator[list[Case], Rows, None]:
        """Try the first place of a scan in all variants, and each other place at one touch phase,
        the next place at the next phase."""
        some = {scan[0]: self.order}
        for number, place in enumerate(scan[1:], 1):
            phase = self.phases[number % len(self.phases)]
            some[place] = [one for one in self.order if one["run.touch_phase"] == phase]
        yield from self._try({place: mine[:1] for place, mine in some.items()})
        yield from self._try(some)

    def _try(self, wanted: dict[int, list[Case]]) -> Generator[list[Case], Rows, None]:
        """Try places that have not failed in variants that were not tried; a variant that fails
        comes first from then on."""
        pairs = [
            (place, one)
            for place, some in wanted.items()
            if place not in self.failed
            for one in some
            if one not in self.tried.get(place, [])
        ]
        if not pairs:
            return
        lasts = lasting(self.lasts_s)
        key, values = self.quantity.key, self.quantity.values
        rows = yield [{key: values[place]} | lasts | one for place, one in pairs]
        self.cases += len(rows)
        for row in without_result(rows):
            named = key in row["status"]
            reason = row["status"] if named else f"{key}: {row['status']}"
            self.reasons.setdefault(row["state"], reason)
        for (place, one), row in zip(pairs, rows, strict=True):
            self.tried.setdefault(place, []).append(one)
            excess = worst_excess(self.goals, row)
            self.excess[place] = max(excess, self.excess.get(place, excess))
            if without_result([row]):
                (self.broken if failed([row]) else self.refused).add(place)
            if place not in self.failed and not all_met(self.goals, row):
                self.failed.add(place)
                self.order = [one, *(other for other in self.order if other != one)]

    def doubtful(self, good: int, top: int) -> list[int]:
        """Return places below the last good one that may fail though those around them do not, and
        that were not tried in all variants; `top`: the last place of the scan up to `good`."""
        known = sorted(place for place in self.excess if place <= good)
        found = set[int]()
        if not self.quantity.by_chance:
            for low, high, beyond in zip(known, known[1:], known[2:], strict=False):
                for a, b, c in ((low, high, beyond), (beyond, high, low)):
                    if abs(c - b) > 1 and max(b, c) <= top and self._reaches(a, b, c):
                        found.add((b + c) // 2)
        elif (
            good + 1 in self.failed
            and len(known) > 1
            and not self._reaches(known[-2], good, good + 1)
        ):
            found.update(range(max(0, good - _BELOW_JUMP), good, 2))
        every = len(self.order)
        return [place for place in sorted(found) if len(self.tried.get(place, ())) < every]

    def _reaches(self, a: int, b: int, c: int) -> bool:
        """Whether the metric, with twice its slope from place `a` to `b`, misses a goal at `c`."""
        slope = (self.excess[b] - self.excess[a]) / (b - a)
        return self.excess[b] + 2.0 * slope * (c - b) > 0.0

    def confirm(self, place: int) -> Generator[list[Case], Rows, bool]:
        """Whether longer runs agree that a value meets the goals; from then on all runs are longer,
        and nothing is known unless they agree."""
        if self.lasts_s == self.long_s:
            return True
        self.lasts_s = self.long_s
        before = self.tried, self.failed, self.excess
        self.tried, self.failed, self.excess = {}, set(), {}
        yield from self.ask([place])
        agrees = place not in self.failed
        if agrees:
            self.tried, self.failed, self.excess = before
        return agrees
