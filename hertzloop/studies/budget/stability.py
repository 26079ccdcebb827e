"""What a law tolerates where it has a linear loop: the loop has to be stable, too.

An instability that grows slowly does not show in a run, so `limit_search.py` cannot find it. Linear
theory gives its verdict at any value. Bits and noise are not part of the linear loop, and jitter
makes it vary with time: there the verdict is that of the scene.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.limits import Boundary, BudgetLimit, BudgetQuantity
from hertzloop.studies.cases.rows import Case
from hertzloop.studies.margin.flight import Margin, margin_of
from hertzloop.studies.margin.growth import stable_in_flight
from hertzloop.studies.margin.loop import PolyphaseLoop, loops_of
from hertzloop.studies.margin.sentences import growth_words

Verdict = Callable[[int], bool]  # whether the loop is stable at a place of the list of values
_CHANGE_THE_LOOP = ("sampling_us", "bandwidth_hz", "mass_kg")


def linear_margin(setup: Setup) -> Margin | None:
    """Return the linear margin; None for a law that has none, or where the numbers fail."""
    try:
        found = margin_of(setup)
    except SceneError:
        return None
    return found if found.applicable else None


def lower_to_stable(
    setup: Setup, margin: Margin | None, quantity: BudgetQuantity, limit: BudgetLimit, points: int
) -> BudgetLimit:
    """Return what a law tolerates of a quantity: the limit of the search, or less where the linear
    loop is unstable.

    Latency counts from 0 on, at every step, as in the margin. Another quantity counts from the
    value of the scene to the limit of the search, at evenly spread values and by bisection.

    Args:
        setup: The plant with its law.
        margin: Its linear margin; None leaves the limit as it is.
        quantity: What is varied.
        limit: What the search found.
        points: Number of values that are looked at.
    """
    if margin is None or limit.boundary is Boundary.IMPOSSIBLE:
        return limit
    good = _last_good(quantity, limit)
    stable = _verdict(setup, margin, quantity)
    if quantity.name == "latency_us":
        places: Sequence[int] = range(max(good, 0) + 1)
    else:
        first = min(quantity.own, max(good, 0))
        places = sorted({round(x) for x in np.linspace(first, max(good, first), points + 1)})
    verdicts = [stable(place) for place in places]
    if all(verdicts):
        return limit
    number = verdicts.index(False)
    if number == 0:
        return replace(
            limit,
            boundary=Boundary.UNSTABLE,
            value=None,
            first_failure=None,
            interval=True,
            holds_again=(),
            share=None,
            reason="",
            impact_alone=limit,
        )
    last, bad = places[number - 1], places[number]
    while bad - last > 1:
        middle = (last + bad) // 2
        last, bad = (middle, bad) if stable(middle) else (last, middle)
    pairs = zip(places[number:], verdicts[number:], verdicts[number - 1 :], strict=False)
    again = [quantity.reported(place) for place, now, before in pairs if now and not before]
    held = {quantity.reported(place): place for place in range(len(quantity.values))}
    again += [value for value in limit.holds_again if stable(held[value])]
    end = len(quantity.within(limit).values) - 1
    return replace(
        limit,
        boundary=Boundary.STABILITY,
        value=quantity.reported(last),
        first_failure=quantity.reported(bad),
        interval=not again,
        holds_again=tuple(value for value in again if value is not None),
        share=(last - quantity.own) / end,
        reason="",
        remark="stability",
        impact_alone=limit,
    )


def _last_good(quantity: BudgetQuantity, limit: BudgetLimit) -> int:
    """Place of the last value that the search tolerates; -1 without one."""
    if limit.boundary is Boundary.NEVER:
        return -1
    if limit.boundary is Boundary.NO_LIMIT:
        return len(quantity.within(limit).values) - 1
    if limit.value is None:
        return 0
    return [quantity.reported(place) for place in range(len(quantity.values))].index(limit.value)


def _verdict(setup: Setup, margin: Margin, quantity: BudgetQuantity) -> Verdict:
    """Return the verdict of linear theory; where it has none, the loop counts as stable."""
    if quantity.name == "latency_us":
        loops = loops_of(setup)
        assert isinstance(loops, PolyphaseLoop)
        unstable = loops.unstable(np.arange(len(quantity.values)))
        return lambda place: not unstable[place]
    if quantity.name in _CHANGE_THE_LOOP and margin.stable:
        values = quantity.values
        return lambda place: (
            place == quantity.own
            or stable_in_flight(setup.vary({quantity.key: values[place]})) is not False
        )
    return lambda place: margin.stable is not False


def stable_under(setup: Setup, margin: Margin | None) -> Callable[[Case], bool]:
    """Return a function that tells whether the linear loop is stable under changes of scene keys.

    Args:
        setup: The plant with its law.
        margin: Its linear margin; None for a law that has none, whose loop counts as stable.
    """
    if margin is None:
        return lambda case: True
    return lambda case: stable_in_flight(setup.vary(case)) is not False


def instability(margin: Margin | None) -> str:
    """Return what is unstable about a loop, as a clause; empty for a stable or unknown one."""
    if margin is None or margin.stable is None:
        return ""
    if not margin.stable:
        return f"the linear loop is unstable ({growth_words(margin.growth)})"
    if margin.latency_limit_steps == -1:
        return "the linear loop is unstable at latency 0"
    return ""
