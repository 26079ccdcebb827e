"""Find up to which value of a quantity a law meets its goals.

A quantity has a finite list of values, from harmless to harsh. A scan at a few of them finds the
first that misses a goal; bisection then finds the boundary to one place of the list. Values of the
scan beyond the boundary that meet the goals show that the region is not an interval. Where the
whole scan meets the goals, it goes on in growing steps to the end of the list: that is where the
quantity has done all that it physically can within a contact, so there is no limit.

A value meets the goals if it does so in every variant: at every touch phase and, for a quantity
that works by chance, with every seed. One variant that fails settles the value, so the variant that
failed last is tried first, and the others only where it passes. The scan tries one touch phase a
value, in turn: many values are worth more than many phases, since a law that misses its goal mostly
does so at every phase. Bisection, and the value that it ends at, take all variants.

Some tolerated values have narrow gaps, where a metric jumps. Beside a jump it often bends towards
the goal: where a straight line through two values tried, of twice their slope, misses the goal
before the next one, the middle is tried too, in all variants. A quantity that works by chance may
fail in one variant without such a sign. Where the metric jumps at the limit, some values below are
tried as well.

Feedback acts for as long as the plate moves, so that the first impact of a long run has no end.
The search then simulates `Search.short_s` only, and confirms its result with a run of
`Search.long_s`. Where that disagrees, as with a loop that grows slowly, the search is repeated
with the longer runs.
"""

import math
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from hertzloop.results.cases import Span
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.goal import Goal, all_met, worst_excess
from hertzloop.studies.budget.limits import Boundary, BudgetLimit, BudgetQuantity
from hertzloop.studies.budget.quantities import contact_us
from hertzloop.studies.cases.evaluate import Case, Rows, Run, not_run
from hertzloop.studies.cases.touch_phases import phases

Asks: TypeAlias = "Generator[list[Case], Rows, BudgetLimit]"  # yields cases, is sent their rows
_BELOW_JUMP = 8  # places below a jump, tried for a quantity that works by chance
_FURTHER = 1.1  # from one value of the scan to the next beyond the usual range
_PHASES, _QUICK_PHASES = 5, 3
_SEEDS, _QUICK_SEEDS = 3, 1
_POINTS, _QUICK_POINTS = 10, 5
# Contact times after the touch that a search simulates at most, and the run that confirms it.
_SHORT_CONTACTS, _LONG_CONTACTS = 60.0, 400.0


@dataclass(frozen=True)
class Search:
    """How thoroughly to search: touch phases, seeds for a quantity that works by chance, the
    number of values in the scan (see `BudgetQuantity.finer`), and how much of a run to simulate in
    the search and to confirm its result, s; None for the whole."""

    phases: tuple[float, ...]
    seeds: tuple[int, ...]
    points: int
    short_s: float | None = None
    long_s: float | None = None


def search_of(setup: Setup, quick: bool, span: Span) -> Search:
    """Return how thoroughly to search; the text above explains the short runs."""
    seeds = _QUICK_SEEDS if quick else _SEEDS
    short_s = setup.first_touch_s + _SHORT_CONTACTS * 1e-6 * contact_us(setup)
    long_s = setup.first_touch_s + _LONG_CONTACTS * 1e-6 * contact_us(setup)
    first = span == "impact"
    return Search(
        phases=phases(_QUICK_PHASES if quick else _PHASES),
        seeds=tuple(setup.seed + i for i in range(seeds)),
        points=_QUICK_POINTS if quick else _POINTS,
        short_s=float(f"{short_s:.3g}") if first and 2.0 * short_s < setup.duration_s else None,
        long_s=float(f"{long_s:.3g}") if first and long_s < setup.duration_s else None,
    )


def variants(quantity: BudgetQuantity, search: Search) -> list[Case]:
    """Return the settings in which a value has to meet the goals."""
    at = [{"run.touch_phase": phase} for phase in search.phases]
    if not quantity.by_chance:
        return at
    return [one | {"run.seed": seed} for seed in search.seeds for one in at]


class _Known:
    """What is known of the values of a quantity: the variants tried, and the values that fail."""

    def __init__(self, quantity: BudgetQuantity, goals: Sequence[Goal], search: Search) -> None:
        self.quantity, self.goals = quantity, goals
        self.order = variants(quantity, search)
        self.phases = search.phases
        self.lasts_s, self.long_s = search.short_s, search.long_s
        self.tried: dict[int, list[Case]] = {}
        self.failed: set[int] = set()
        self.excess: dict[int, float] = {}  # by place, the largest of the variants tried
        self.cases = 0
        self.reason = ""
        self.refused: set[int] = set()  # places of which a case could not be run

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
        lasts = {} if self.lasts_s is None else {"run.duration_s": self.lasts_s}
        key, values = self.quantity.key, self.quantity.values
        rows = yield [{key: values[place]} | lasts | one for place, one in pairs]
        self.cases += len(rows)
        lacking = not_run(rows)
        if lacking and not self.reason:
            status = lacking[0]["status"]
            self.reason = (
                status if self.quantity.key in status else f"{self.quantity.key}: {status}"
            )
        for (place, one), row in zip(pairs, rows, strict=True):
            self.tried.setdefault(place, []).append(one)
            excess = worst_excess(self.goals, row)
            self.excess[place] = max(excess, self.excess.get(place, excess))
            if not_run([row]):
                self.refused.add(place)
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


def limit_of(quantity: BudgetQuantity, goals: Sequence[Goal], search: Search) -> Asks:
    """Search the limit of one quantity: a generator of lists of cases that is sent their rows, in
    the same order, and returns the `BudgetLimit`."""
    end = len(quantity.values) - 1
    last = end if quantity.usual is None else quantity.usual
    known = _Known(quantity, goals, search)
    if last < 1:
        known.reason = f"{quantity.key}: the scene allows only {quantity.values[0]:g}"
        return _result(quantity, known, None, [], Boundary.IMPOSSIBLE)
    count = min(search.points * quantity.finer, last + 1)
    scan = quantity.scan or sorted({1, *(round(i * last / (count - 1)) for i in range(count))})
    look = known.ask if quantity.scan else known.glance
    yield from look(scan)
    if known.refused.issuperset(scan[1:]):
        return _result(quantity, known, None, scan, Boundary.IMPOSSIBLE)
    good = yield from _last_good(known, scan)
    if good == last < end:
        steps = math.ceil(math.log(end / last) / math.log(_FURTHER))
        more = sorted({round(last * (end / last) ** (i / steps)) for i in range(1, steps + 1)})
        yield from look([last, *more])
        scan = [*scan, *more]
        good = yield from _last_good(known, scan)
    if good is not None:
        agreed = yield from known.confirm(good)
        if not agreed:
            yield from look([place for place in scan if place <= good])
            good = yield from _last_good(known, scan)
    top = scan[-1]
    if quantity.by_chance:
        scan = scan[:: quantity.finer]  # all variants of many values would take most of the time
    if good is None:
        yield from known.ask(scan)
        return _result(quantity, known, None, scan, Boundary.NEVER, top)
    if good == top:
        return _result(quantity, known, top, scan, Boundary.NO_LIMIT, top)
    yield from known.ask([place for place in scan if place > good])
    boundary = Boundary.FOUND
    if good + 1 in known.refused:
        boundary = Boundary.REFUSED
    elif quantity.reported(good) is None:
        boundary = Boundary.IDEAL_ONLY
    return _result(quantity, known, good, scan, boundary, top)


def _last_good(known: _Known, scan: Sequence[int]) -> Generator[list[Case], Rows, int | None]:
    """The last place before the first that misses the goals, by bisection between those of a scan;
    None where the first place misses them. The place meets the goals in all variants."""
    while True:
        bad = min(known.failed, default=scan[-1] + 1)
        if bad == scan[0]:
            return None
        good = max(place for place in scan if place < bad)
        while bad - good > 1 and bad <= scan[-1]:
            middle = (good + bad) // 2
            yield from known.ask([middle])
            if middle in known.failed:
                bad = middle
            else:
                good = middle
        yield from known.ask([good])
        top = max(place for place in scan if place <= good)
        while good not in known.failed and (doubtful := known.doubtful(good, top)):
            yield from known.ask(doubtful)
            if not known.failed.isdisjoint(doubtful):
                break
        else:
            if good not in known.failed:
                return good


def _result(
    quantity: BudgetQuantity,
    known: _Known,
    good: int | None,
    scan: Sequence[int],
    boundary: Boundary,
    top: int | None = None,
) -> BudgetLimit:
    last = len(quantity.values) - 1 if top is None else top
    beyond = last if boundary is Boundary.IMPOSSIBLE else -1 if good is None else good
    again = [place for place in scan if place > beyond and place not in known.failed]
    ends = [quantity.reported(place) for place in (0, 1, last) if place <= last]
    finite = [value for value in ends if value is not None]
    found = boundary in (Boundary.FOUND, Boundary.REFUSED)
    reason = known.reason if boundary in (Boundary.REFUSED, Boundary.IMPOSSIBLE) else ""
    if boundary is Boundary.NO_LIMIT:
        reason = f"at {quantity.reported(last):.4g} {quantity.unit} {quantity.end}."
    share = None
    if boundary in (Boundary.FOUND, Boundary.IDEAL_ONLY):
        assert good is not None
        share = (good - quantity.own) / last
    return BudgetLimit(
        quantity=quantity.name,
        key=quantity.key,
        unit=quantity.unit,
        boundary=boundary,
        value=quantity.reported(good) if found and good is not None else None,
        first_failure=quantity.reported(good + 1)
        if good is not None and boundary in (Boundary.FOUND, Boundary.IDEAL_ONLY)
        else None,
        searched=(min(finite), max(finite)) if finite else (0.0, 0.0),
        interval=not again,
        holds_again=tuple(x for x in map(quantity.reported, again) if x is not None),
        share=share,
        cases=known.cases,
        reason=reason,
    )


def side_by_side(
    searches: Sequence[Asks],
    run: Run,
    on_round: Callable[[int], None] = lambda finished: None,
) -> list[BudgetLimit]:
    """Advance several searches together, so that all cores have work.

    Args:
        searches: Generators as of `limit_of`.
        run: Returns the rows of cases, in their order.
        on_round: Is told after each round how many searches have finished.

    Returns:
        The limits, in the order of the searches.
    """
    found: dict[int, BudgetLimit] = {}
    asked: dict[int, list[Case]] = {}

    def advance(number: int, rows: Rows | None) -> None:
        try:
            search = searches[number]
            asked[number] = next(search) if rows is None else search.send(rows)
        except StopIteration as end:
            asked.pop(number, None)
            found[number] = end.value

    for number in range(len(searches)):
        advance(number, None)
    while asked:
        numbers = list(asked)
        rows = run([case for number in numbers for case in asked[number]])
        at = 0
        for number in numbers:
            count = len(asked[number])
            advance(number, rows[at : at + count])
            at += count
        on_round(len(found))
    return [found[number] for number in range(len(searches))]
