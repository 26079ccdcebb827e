"""A map of the two tightest quantities: where both together meet the goals."""

import numpy as np

from hertzloop.studies.budget.effort import lasting
from hertzloop.studies.budget.goal import all_met
from hertzloop.studies.budget.limits import BudgetLimit, BudgetQuantity
from hertzloop.studies.budget.plant_limits import LimitProblem
from hertzloop.studies.budget.quantities import quantities_of
from hertzloop.studies.budget.result import InPlant, PairMap, nearest
from hertzloop.studies.cases.rows import RunCases

_PLACES = 11  # values of a quantity in a map
_BEYOND = 1.6  # times the distance to the limit, in places, that a map shows


def simulate_pair_map(problem: LimitProblem, plant: InPlant, run: RunCases) -> PairMap | None:
    """Simulate a map of the two tightest quantities of a plant.

    Args:
        problem: What the limits of the plant were asked for.
        plant: The plant with its limits.
        run: Returns the rows of cases, in their order.

    Returns:
        The map; None where fewer than two quantities have a limit.
    """
    limits = nearest(plant.limits)[:2]
    if len(limits) < 2:
        return None
    known = {quantity.name: quantity for quantity in quantities_of(problem.setup)}
    effort = problem.effort
    across, down = (known[limit.quantity] for limit in limits)
    places = [_places(known[limit.quantity], limit) for limit in limits]
    cases = [
        {across.key: across.values[i], down.key: down.values[j], "run.touch_phase": phase}
        | lasting(effort.short_s)
        for j in places[1]
        for i in places[0]
        for phase in effort.phases
    ]
    met = np.array([all_met(problem.goals, row) for row in run(cases)], dtype=float)
    shape = (len(places[1]), len(places[0]), len(effort.phases))
    return PairMap(across, down, places[0], places[1], met.reshape(shape).mean(axis=2))


def _places(quantity: BudgetQuantity, limit: BudgetLimit) -> tuple[int, ...]:
    last = len(quantity.within(limit).values) - 1
    good = quantity.own + round((limit.share or 0.0) * last)
    end = min(last, max(good + 3, round(_BEYOND * good)))
    return tuple(sorted({round(x) for x in np.linspace(0, end, _PLACES)}))
