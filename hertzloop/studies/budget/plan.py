"""What a budget searches, checked before any case runs: scene with law, goals, distributions."""

from dataclasses import dataclass
from typing import Any

from hertzloop.scene.errors import SceneError
from hertzloop.scene.rules import check_conserves
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.goal import DEFAULT_GOAL, Goal, parse_goal
from hertzloop.studies.budget.quantities import QUANTITIES
from hertzloop.studies.budget.request import BudgetRequest
from hertzloop.studies.cases.design import Design
from hertzloop.studies.cases.identity import work_of
from hertzloop.studies.cases.uncertain import UncertainInputs
from hertzloop.studies.cases.uncertain_file import read_uncertain


@dataclass(frozen=True)
class BudgetPlan:
    """A budget that can be searched.

    Attributes:
        setup: The scene with its law.
        goals: What the law has to do, all of it.
        uncertain: Distributions of uncertain keys, if the probability is asked for.
        request: What was asked for.
    """

    setup: Setup
    goals: tuple[Goal, ...]
    uncertain: UncertainInputs | None
    request: BudgetRequest

    @property
    def identity(self) -> dict[str, Any]:
        """Everything that decides the cases."""
        request = self.request
        searched = [request.span, request.quick, request.with_real, *request.only]
        work = work_of([self.setup], [self.setup.scene.controller.law], Design(()))
        return {**work, "budget": [*map(str, self.goals), *searched]}


def plan_budget(setup: Setup, request: BudgetRequest) -> BudgetPlan:
    """Return the budget to search.

    Args:
        setup: The scene with its law.
        request: What to search.

    Raises:
        SceneError: there is no law, or a goal, a quantity or an option cannot be used.
    """
    check_conserves(setup.run.scheme)
    goals = tuple(parse_goal(text) for text in request.goals or [DEFAULT_GOAL])
    if not setup.scene.controller.has_law:
        raise SceneError(
            "controller.law = 'off': has no limits. Name a law, for example --law slope_threshold"
        )
    for name in request.only:
        if name not in QUANTITIES:
            raise SceneError(
                f"--only = '{name}': is not a quantity. Choose from {', '.join(QUANTITIES)}"
            )
    uncertain = read_uncertain(request.uncertain, setup) if request.uncertain else None
    for option in ("within", "most_cases"):
        value = getattr(request, option)
        if value != BudgetRequest.model_fields[option].default and not uncertain:
            raise SceneError(
                f"--{option.replace('_', '-')} = {value:g}: has no effect without --uncertain. "
                "Remove it, or name a file of distributions."
            )
    return BudgetPlan(setup, goals, uncertain, request)
