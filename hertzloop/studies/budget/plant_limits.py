"""Find the limits of a law in a plant: by runs, then by the stability of the linear loop."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from hertzloop.scene.controller import mean_latency_us
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.effort import SearchEffort
from hertzloop.studies.budget.goal import Goal
from hertzloop.studies.budget.limit_search import Asks, limit_of
from hertzloop.studies.budget.limits import BudgetLimit
from hertzloop.studies.budget.quantities import quantities_of
from hertzloop.studies.budget.stability import lower_to_stable
from hertzloop.studies.cases.rows import Case, Rows, RunCases
from hertzloop.studies.margin.flight import Margin


@dataclass(frozen=True)
class LimitProblem:
    """Whose limits to find, and how.

    Attributes:
        setup: The plant with its law.
        margin: The linear margin of its loop; None for a law that has none.
        goals: What the law has to do, all of it.
        effort: How thoroughly to search.
    """

    setup: Setup
    margin: Margin | None
    goals: Sequence[Goal]
    effort: SearchEffort


def limits_of(
    problem: LimitProblem,
    names: Sequence[str],
    run: RunCases,
    on_progress: Callable[[float], None] = lambda share: None,
) -> tuple[BudgetLimit, ...]:
    """Return the limits of a law in a plant, in the order of `quantities_of`.

    Args:
        problem: The plant, the goals, and how thoroughly to search.
        names: Names of the quantities; all if empty.
        run: Returns the rows of cases, in their order.
        on_progress: Called with the finished share of the searches.
    """
    setup, effort = problem.setup, problem.effort
    wanted = [one for one in quantities_of(setup) if one.name in names or not names]
    by_runs = side_by_side(
        [limit_of(one, problem.goals, effort) for one in wanted],
        run,
        lambda done: on_progress(done / len(wanted)),
    )
    return tuple(
        _with_mean_latency(
            setup, lower_to_stable(setup, problem.margin, quantity, limit, effort.points)
        )
        for quantity, limit in zip(wanted, by_runs, strict=True)
    )


def side_by_side(
    searches: Sequence[Asks],
    run: RunCases,
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


def _with_mean_latency(setup: Setup, limit: BudgetLimit) -> BudgetLimit:
    """Return a limit of the jitter with the mean latency of the force that acts under it."""
    if limit.quantity != "jitter_us" or not limit.value:
        return limit
    mean_us = mean_latency_us(setup.vary({limit.key: limit.value}))
    remark = f"mean latency {mean_us:.3g} us"
    return replace(limit, remark=f"{limit.remark}, {remark}" if limit.remark else remark)
