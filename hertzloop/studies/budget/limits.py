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
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, TypeAlias

from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.results.cases import uncontrolled
from hertzloop.scene.errors import SceneError
from hertzloop.scene.quantities import SENSED
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.goal import Goal, all_met, worst_excess
from hertzloop.studies.cases.evaluate import Rows, not_run

Case = dict[str, Any]
Asks: TypeAlias = "Generator[list[Case], Rows, BudgetLimit]"  # yields cases, is sent their rows
_NOISE_DECADES, _PLACES_A_DECADE = 6, 25
_BANDWIDTHS_HZ = (1e3, 1e7)  # the largest acts within a tenth of a step: it stands for ideal
_MASSES = (1e-3, 1e2)  # of the mass of the sphere
_MOST_BITS, _COARSE_BITS = 24, 12  # above 12 bits the scan takes every fourth value
_BELOW_JUMP = 8  # places below a jump, tried for a quantity that works by chance
_FURTHER = 1.1  # from one value of the scan to the next beyond the usual range
_FEW = 64  # sampling periods that are all scanned: a law may miss its goal at every other one


class Boundary(StrEnum):
    """How a search ended."""

    FOUND = "found"
    NO_LIMIT = "no limit"  # the goals are met up to the physical end of the quantity
    REFUSED = "refused"  # the goals are met up to the first value that the scene refuses
    NEVER = "never met"  # the most harmless value misses a goal
    IDEAL_ONLY = "ideal only"  # no finite value meets the goals
    IMPOSSIBLE = "not possible"  # the scene refuses the quantity
    STABILITY = "stability"  # beyond the value the linear loop is unstable; see `stability`
    UNSTABLE = "none (unstable loop)"  # the linear loop is unstable at the most harmless value


@dataclass(frozen=True)
class BudgetQuantity:
    """A quantity whose limit is asked for.

    `values`: from harmless to harsh, as the scene key takes them, up to the physical end; `end`:
    what the last value means, in a sentence; `usual`: place of the last value that the scan tries
    before it goes on to the end, None for all; `scale`: reported value over value of the key;
    `own`: place in the list of the scene's own value; `by_chance`: whether the effect depends on
    the seed; `finer`: times as many values in the scan as `Search.points`, where the tolerated
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

    def within(self, limit: "BudgetLimit") -> "BudgetQuantity":
        """Return the quantity with those values only that the search of a limit went through."""
        places = range(len(self.values))
        last = max(place for place in places if self.reported(place) in limit.searched)
        return replace(self, values=self.values[: last + 1], usual=None)


@dataclass(frozen=True)
class BudgetLimit:
    """Up to where a law meets its goals.

    `value`: the last value that does, None where no limit was found; `first_failure`: the next
    value of the list, which misses a goal; `searched`: least and largest value that the search
    reached; `interval`: whether no value of the scan beyond the boundary meets the goals again;
    `holds_again`: those that do; `share`: the part of the searched list between the scene's own
    value and the boundary, negative where the scene is beyond it; `reason`: why there is no limit,
    or why the scene refuses values; `remark`: what a table says behind the value; `impact_alone`:
    what the search found, where the stability of the linear loop allows less, else None. Values
    are in `unit`.
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


def limit_words(limit: BudgetLimit) -> str:
    """Return a limit in words, for a cell of a table."""
    if limit.value is None:
        return limit.boundary.value
    words = "at least" if limit.quantity in LEAST else "up to"
    remark = f" ({limit.remark})" if limit.remark else ""
    return f"{words} {limit.value:.4g} {limit.unit}{remark}"


def contact_us(setup: Setup) -> float:
    """Return the contact time on a rigid plate, us: the time scale of a scene."""
    return 1e6 * rigid_impact(setup.sphere, setup.contact).contact_s


LEAST = ("bits", "bandwidth_hz")  # a law tolerates these down to a value, the others up to one
NAMES = ("latency_us", "jitter_us", "bits", "noise", "sampling_us", "bandwidth_hz", "mass_kg")


def quantities_of(setup: Setup) -> list[BudgetQuantity]:
    """Return the quantities of a scene with the values that are searched, in the order of `NAMES`.

    Latency and jitter go to twice the contact time on a rigid plate in whole steps, the sampling
    period to the contact time itself; bits from 24 to 1 after an ideal converter; noise over six
    decades up to the range of a converter; bandwidth from 10 MHz to 1 kHz; mass from 1e-3 to 100
    times that of the sphere. The last three have 25 values a decade. Times go on to the contact
    time without control, and the bandwidth to the inverse of that, where they do not reach it.
    """
    scene, step_us = setup.scene, setup.step_ns / 1000.0
    rigid_us, free_us = contact_us(setup), 1e6 * uncontrolled(setup, "impact").contact_time_s
    # A latency as long as the run is refused.
    most = min(2.0 * rigid_us, 0.45e6 * (setup.duration_s - setup.lead_in_s))
    usual, used = (max(2, math.ceil(x / step_us)) for x in (most, rigid_us))
    longest = math.ceil(min(free_us, 1e6 * setup.duration_s - step_us) / step_us)
    times = tuple(i * step_us for i in range(max(usual, longest) + 1))
    periods = tuple(range(1, max(used, longest) + 1))
    bits = ("ideal", *range(_MOST_BITS, 0, -1))
    fine = tuple(range(1, _MOST_BITS - _COARSE_BITS, 4))
    high_hz, low_hz = max(_BANDWIDTHS_HZ), min(_BANDWIDTHS_HZ)
    slow_hz = max(1.0, 1e6 / (2.0 * math.pi * free_us))
    slower = _spread(slow_hz, low_hz)[-2::-1] if slow_hz < low_hz else ()
    bandwidths = (*reversed(_spread(low_hz, high_hz)), *slower)
    least_kg, most_kg = (share * setup.sphere.mass_kg for share in _MASSES)
    masses = (0.0, *_spread(max(least_kg, 1e-6), min(most_kg, 1e3)))
    width = converter_width(setup)
    noises = (0.0, *(() if width is None else _spread(width * 10.0**-_NOISE_DECADES, width)))
    line, sensors, actuator = scene.controller, scene.sensors, scene.actuator
    own_hz = actuator.bandwidth_hz
    return [
        BudgetQuantity(
            "latency_us",
            "controller.latency_us",
            "us",
            times,
            "the latency is as long as the contact",
            usual,
            _place(times, line.latency_us),
            finer=2,
        ),
        BudgetQuantity(
            "jitter_us",
            "controller.jitter_us",
            "us",
            times,
            "the jitter is as long as the contact",
            usual,
            _place(times, line.jitter_us),
            by_chance=True,
            finer=2,
        ),
        BudgetQuantity(
            "bits",
            "sensors.bits",
            "bits",
            bits,
            "the converter only tells two values apart",
            None,
            bits.index(sensors.bits),
            scan=(0, *fine, *range(_MOST_BITS - _COARSE_BITS + 1, len(bits))),
        ),
        BudgetQuantity(
            "noise",
            "sensors.noise_rms",
            f"{SENSED[setup.quantity].unit} rms",
            noises,
            "the noise is as large as the range of the converter",
            None,
            _place(noises, sensors.noise_rms),
            by_chance=True,
            finer=4,
        ),
        BudgetQuantity(
            "sampling_us",
            "sensors.every_steps",
            "us",
            periods,
            "the contact has one sample",
            used - 1,
            _place(periods, sensors.every_steps),
            scale=step_us,
            finer=4,
            scan=tuple(range(used)) if used <= _FEW else (),
        ),
        BudgetQuantity(
            "bandwidth_hz",
            "actuator.bandwidth_hz",
            "Hz",
            bandwidths,
            "the actuator is slower than the contact",
            len(bandwidths) - len(slower) - 1,
            0 if own_hz is None else max(0, sum(hz >= own_hz for hz in bandwidths) - 1),
        ),
        BudgetQuantity(
            "mass_kg",
            "actuator.mass_kg",
            "kg",
            masses,
            f"the actuator is too heavy for the {setup.sphere.noun} to move",
            None,
            _place(masses, actuator.mass_kg or 0.0),
        ),
    ]


def converter_width(setup: Setup) -> float | None:
    """Return the range of a converter for what the scene samples, in the unit of that quantity;
    None where the scene allows none."""
    try:
        found = setup.vary({"sensors.bits": 16}).sensor.full_scale
    except SceneError:
        return None
    return None if found is None else found[1] - found[0]


def _spread(low: float, high: float) -> tuple[float, ...]:
    """Values evenly spread on a logarithmic scale, both ends included, in four digits."""
    count = max(1, round(math.log10(high / low) * _PLACES_A_DECADE))
    return tuple(float(f"{low * (high / low) ** (i / count):.4g}") for i in range(count + 1))


def _place(values: Sequence[float], own: float) -> int:
    """Place of the last value that is not beyond the scene's own."""
    return max(0, sum(value <= own for value in values) - 1)


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
    run: Callable[[list[Case]], Rows],
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
