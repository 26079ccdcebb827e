"""The limit of jitter against the worst sequence of latencies that a search finds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.goal import Goal, all_met, worst_excess
from hertzloop.studies.cases.rows import Row, RunCases, without_result
from hertzloop.studies.cases.touch_phases import Spread, spread_of
from hertzloop.studies.worst.search import Objective, WorstSearch, WorstSequence

_DRAWS = 200  # of random jitter, beside the worst sequence


@dataclass(frozen=True)
class WorstLimit:
    """Up to which range of additional latency no sequence that misses a goal was found.

    Attributes:
        tolerated_us: The range, us; None if a goal is missed without additional latency.
        worst: Worst sequence within the next range, which misses a goal; None if there is none up
            to the largest range.
        draws: Metrics of the goals over random draws of jitter within that range.
        searched_us: Largest range that was searched, us.
        cases: Number of cases.
    """

    tolerated_us: float | None
    worst: WorstSequence | None
    draws: dict[str, Spread]
    searched_us: float
    cases: int


def objective_of(goals: Sequence[Goal]) -> Objective:
    """Return the objective under which a sequence is the worse the more it misses the goals.

    The excess is relative to the limits of the goals, and negative if all goals are met. Of a
    sequence that the scene refuses nothing is known.
    """

    def excess(row: Row) -> float:
        return -math.inf if without_result([row]) else worst_excess(goals, row)

    def missed(row: Row) -> bool:
        return not without_result([row]) and not all_met(goals, row)

    return Objective(tuple(goal.metric for goal in goals), excess, missed)


def worst_limit(
    setup: Setup, goals: Sequence[Goal], most_steps: int, phases: Sequence[float], run: RunCases
) -> WorstLimit:
    """Find up to which range of additional latency the goals are met, as far as the search goes.

    A sequence within a range is also within a larger one, so the limit is found by bisection.

    Args:
        setup: The scene, without jitter and latency trace.
        goals: What the law has to do.
        most_steps: Largest range that is searched, steps.
        phases: Touch phases at which simple sequences are tried.
        run: Returns the rows of cases, in their order.

    Raises:
        CaseFailed: a case failed in its run.
    """
    step_us = setup.step_ns / 1000.0
    search = WorstSearch(setup, objective_of(goals), phases, run)

    def misses(steps: int) -> bool:
        return search.within(steps, to_first_miss=True).missed

    if misses(0):
        return WorstLimit(None, None, {}, most_steps * step_us, search.cases)
    if not misses(most_steps):
        return WorstLimit(most_steps * step_us, None, {}, most_steps * step_us, search.cases)
    good, bad = 0, most_steps
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (good, middle) if misses(middle) else (middle, bad)
    worst = search.within(bad)
    jitter = {"controller.jitter_us": bad * step_us, "run.touch_phase": worst.touch_phase}
    rows = run([jitter | {"run.seed": setup.seed + i} for i in range(_DRAWS)])
    draws = {goal.metric: spread_of([row[goal.metric] for row in rows]) for goal in goals}
    cases = search.cases + _DRAWS
    return WorstLimit(good * step_us, worst, draws, most_steps * step_us, cases)
