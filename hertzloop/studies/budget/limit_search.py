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
The search then simulates `SearchEffort.short_s` only, and confirms its result with a run of
`SearchEffort.long_s`. Where that disagrees, as with a loop that grows slowly, the search is
repeated with the longer runs.
"""

import math
from collections.abc import Generator, Sequence
from typing import TypeAlias

from hertzloop.common import readable
from hertzloop.results.cases import CaseState
from hertzloop.studies.budget.effort import SearchEffort
from hertzloop.studies.budget.goal import Goal
from hertzloop.studies.budget.limits import Boundary, BudgetLimit, BudgetQuantity
from hertzloop.studies.budget.tried_values import TriedValues
from hertzloop.studies.cases.rows import Case, Rows

Asks: TypeAlias = "Generator[list[Case], Rows, BudgetLimit]"  # yields cases, is sent their rows
_FURTHER = 1.1  # from one value of the scan to the next beyond the usual range


def limit_of(quantity: BudgetQuantity, goals: Sequence[Goal], effort: SearchEffort) -> Asks:
    """Search the limit of one quantity: a generator of lists of cases that is sent their rows, in
    the same order, and returns the `BudgetLimit`."""
    end = len(quantity.values) - 1
    last = end if quantity.usual is None else quantity.usual
    known = TriedValues(quantity, goals, effort)
    if last < 1:
        only = f"{quantity.key}: the scene allows only {quantity.values[0]:g}"
        known.reasons[CaseState.NOT_RUN] = only
        return _result(quantity, known, None, [], Boundary.IMPOSSIBLE)
    count = min(effort.points * quantity.finer, last + 1)
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
    if good + 1 in known.broken:
        boundary = Boundary.FAILED
    elif good + 1 in known.refused:
        boundary = Boundary.REFUSED
    elif quantity.reported(good) is None:
        boundary = Boundary.IDEAL_ONLY
    return _result(quantity, known, good, scan, boundary, top)


def _last_good(known: TriedValues, scan: Sequence[int]) -> Generator[list[Case], Rows, int | None]:
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
    known: TriedValues,
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
    found = boundary in (Boundary.FOUND, Boundary.REFUSED, Boundary.FAILED)
    reason = ""
    if boundary in (Boundary.REFUSED, Boundary.IMPOSSIBLE):
        reason = known.reasons.get(CaseState.NOT_RUN, "")
    if boundary is Boundary.FAILED:
        reason = known.reasons.get(CaseState.FAILED, "")
    if boundary is Boundary.NO_LIMIT:
        at_end = readable.quantity(quantity.reported(last) or 0.0, quantity.unit, 4)
        reason = f"at {at_end} {quantity.end}."
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
        if good is not None and boundary in (Boundary.FOUND, Boundary.FAILED, Boundary.IDEAL_ONLY)
        else None,
        searched=(min(finite), max(finite)) if finite else (0.0, 0.0),
        interval=not again,
        holds_again=tuple(x for x in map(quantity.reported, again) if x is not None),
        share=share,
        cases=known.cases,
        reason=reason,
    )
