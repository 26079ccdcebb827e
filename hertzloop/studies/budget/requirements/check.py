"""Check requirements on a law: metrics and goals in runs, limits, the probability of the goals."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hertzloop.results.cases import CASE_FACTS, CaseState
from hertzloop.results.spans import Span
from hertzloop.results.touch_phases import phases as spread_evenly
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.effort import effort_of
from hertzloop.studies.budget.goal import DEFAULT_GOAL, parse_goal, worst_excess
from hertzloop.studies.budget.limits import LEAST, Boundary, BudgetLimit
from hertzloop.studies.budget.plant_limits import LimitProblem, limits_of
from hertzloop.studies.budget.probability import Draws, Probability, probability
from hertzloop.studies.budget.quantities import quantities_of
from hertzloop.studies.budget.requirements.requirement import SceneRequirement, beside
from hertzloop.studies.budget.stability import instability, linear_margin, stable_under
from hertzloop.studies.cases.evaluate import Pool, evaluate
from hertzloop.studies.cases.rows import Rows, RunCases, check_all_ran, metric_of
from hertzloop.studies.cases.uncertain_file import read_uncertain
from hertzloop.studies.margin.flight import Margin

_WITHIN = 0.01  # half the width of the interval of a required probability
_WHOLE_NUMBERS = ("sensors.bits", "sensors.every_steps")


@dataclass
class CheckedRequirement:
    """What became of a requirement in a scene.

    Attributes:
        row: The requirement.
        holds: Sentences on what holds, and by how much.
        fails: Sentences on what fails.
        command: Command that reproduces the first failure.
        unstable: Whether the loop is unstable, in a run or by linear theory.
        measured: Metrics with an expected value.
        warnings: Sentences on a linear loop that is unstable while the requirement holds.
    """

    row: SceneRequirement
    holds: list[str] = field(default_factory=list)
    fails: list[str] = field(default_factory=list)
    command: str = ""
    unstable: bool = False
    measured: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether the requirement holds."""
        return not self.fails

    def fail(self, sentence: str, case: dict[str, Any]) -> None:
        """Note a failure; the first one gives the command that reproduces it."""
        self.fails.append(sentence)
        self.command = self.command or self.row.command(case)


def digits_of(setup: Setup, metric: str, value: float) -> float:
    """Return the part of a metric that cannot be predicted, in its unit: what the expected error of
    the plate's model makes of it, at least the accuracy of the scene."""
    error = max(setup.run.accuracy, setup.expected_error)
    if metric.endswith("_db"):
        return (CASE_FACTS[metric].db or 10.0) * math.log10(1.0 + error)
    return 2.0 * error * abs(value)


def check(pool: Pool, row: SceneRequirement) -> CheckedRequirement:
    """Check one row.

    Args:
        pool: Runs cases.
        row: The requirement in one scene.

    Raises:
        CaseFailed: a case failed in its run.
        SceneError: the row cannot be run.
    """
    one, setup = row.requirement, row.setup()
    margin = linear_margin(setup)
    unstable_words = instability(margin) if margin is not None and margin.stable is False else ""
    found = CheckedRequirement(row)

    def run(cases: list[dict[str, Any]]) -> Rows:
        return evaluate(pool, setup, one.span, cases)

    if (one.goal and one.probability is None) or one.expect:
        _check_runs(found, setup, run)
    if one.limit:
        _check_limits(found, setup, margin, run)
    if one.probability is not None and one.uncertain is not None:
        inputs = read_uncertain(Path(beside(row.folder, one.uncertain)), setup)
        draws = Draws(inputs, _WITHIN, one.cases)
        likely = probability(setup, one.goals, draws, run, stable_under(setup, margin))
        _check_probability(found, likely)
    # A row that fails by the instability says so already.
    if unstable_words and not found.unstable:
        found.unstable = True
        if not any(unstable_words in sentence for sentence in found.fails):
            found.warnings.append(unstable_words)
    return found


def _check_runs(found: CheckedRequirement, setup: Setup, run: RunCases) -> None:
    """Check the expected metrics in the scene as it is, and the goals at every touch phase."""
    one = found.row.requirement
    phases = [{"run.touch_phase": phase} for phase in spread_evenly(one.phases)]
    as_it_is: list[dict[str, Any]] = [{}] if one.expect else []
    cases = [*as_it_is, *phases]
    rows = run(cases)
    check_all_ran(rows, found.row.name)
    for each, case in zip(rows, cases, strict=True):
        if each["state"] == CaseState.UNSTABLE and not found.unstable:
            found.unstable = True
            found.fail("the closed loop is unstable", case)
    for metric, value in one.expect.items():
        measured = found.measured[metric] = metric_of(rows[0], metric)
        allowed = one.tolerance.get(metric, digits_of(setup, metric, value))
        sentence = f"{metric} = {measured:.6g}, expected {value:.6g} within {allowed:.2g}"
        if abs(measured - value) <= allowed:
            found.holds.append(sentence)
        elif not found.unstable:
            found.fail(sentence, {})
    over_phases = rows[len(as_it_is) :]
    for goal in one.goals if one.probability is None else ():
        worst = max(range(len(phases)), key=lambda i: worst_excess([goal], over_phases[i]))
        excess = goal.excess(over_phases[worst])
        allowed = one.tolerance.get(goal.metric, digits_of(setup, goal.metric, goal.limit))
        if excess <= allowed:
            found.holds.append(f"{goal} with {-excess:.3g} to spare")
        elif math.isfinite(excess):
            found.fail(
                f"{goal} is missed by {excess:.3g}: {goal.metric} = "
                f"{over_phases[worst][goal.metric]:.6g} at run.touch_phase = "
                f"{phases[worst]['run.touch_phase']:g}",
                phases[worst],
            )
        elif not found.unstable:
            found.fail(f"{goal}: the metric is not defined in this scene", phases[worst])


def _check_probability(found: CheckedRequirement, likely: Probability) -> None:
    """Check the required probability by its lower end: it has to be shown, not only possible."""
    one = found.row.requirement
    assert one.probability is not None
    low, high = likely.interval
    sentence = (
        f"probability {likely.value:z.4f} ({low:z.4f} to {high:z.4f}, {likely.cases} cases), "
        f"required {one.probability:g}"
    )
    if low >= one.probability:
        found.holds.append(sentence)
    else:
        found.fail(sentence, likely.worst)


def _check_limits(
    found: CheckedRequirement, setup: Setup, margin: Margin | None, run: RunCases
) -> None:
    """Check the tolerated values of quantities."""
    one = found.row.requirement
    known = {quantity.name: quantity for quantity in quantities_of(setup)}
    for name in one.limit:
        if name not in known:
            raise SceneError(
                f"{one.name}, limit.{name}: is not a quantity. Choose from {', '.join(known)}"
            )
    goals = one.goals or (parse_goal(DEFAULT_GOAL),)
    problem = LimitProblem(setup, margin, goals, effort_of(setup, False, one.span))
    by_name = {limit.quantity: limit for limit in limits_of(problem, list(one.limit), run)}
    failed: dict[str, Any] = {}
    any_failed = False
    for name, wanted in one.limit.items():
        limit = by_name[name]
        enough = limit.boundary is Boundary.NO_LIMIT or (
            limit.value is not None
            and (limit.value <= wanted if name in LEAST else limit.value >= wanted - 1e-12)
        )
        sentence = _limit_sentence(limit, wanted, margin, one.span)
        if enough:
            found.holds.append(sentence)
            continue
        any_failed = True
        found.fails.append(sentence)
        if limit.boundary is Boundary.UNSTABLE:  # the scene shows it, latency at its least
            failed = failed or ({limit.key: 0} if name == "latency_us" else {})
            continue
        value = wanted / known[name].scale
        failed = failed or {limit.key: round(value) if limit.key in _WHOLE_NUMBERS else value}
    if any_failed:
        found.command = found.command or found.row.command(failed)


def _limit_sentence(found: BudgetLimit, wanted: float, margin: Margin | None, span: Span) -> str:
    """What is tolerated and required; the instability where it sets the limit."""
    if found.impact_alone is None:
        got = found.boundary.value if found.value is None else f"{found.value:.6g}"
        why = f"; {found.reason}" if found.boundary is Boundary.FAILED else ""
        return f"{found.quantity}: tolerated {got} {found.unit}, required {wanted:.6g}{why}"
    if found.boundary is Boundary.UNSTABLE:
        why = instability(margin) or "the linear loop is unstable there"
    else:
        why = f"the linear loop is unstable at {found.first_failure:.6g} {found.unit}"
    return (
        f"{found.quantity}: tolerated {found.words()}, required {wanted:.6g}, because {why}; "
        f"tolerated by the {span} alone: {found.impact_alone.words()}"
    )
