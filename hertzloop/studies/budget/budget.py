"""The budget of a law in a scene: its effect and its limits, in the scene and in the real plant."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hertzloop.results.cases import CaseState, uncontrolled
from hertzloop.results.predictability import whole_run_known
from hertzloop.results.span_metrics import MUCH_DB
from hertzloop.results.spans import IN_WORDS, OTHER, Span
from hertzloop.results.touch_phases import spread_of
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.effort import SearchEffort, effort_of, lasting
from hertzloop.studies.budget.goal import METRICS, Goal, all_met, worst_excess
from hertzloop.studies.budget.plan import BudgetPlan
from hertzloop.studies.budget.plant_limits import LimitProblem, limits_of
from hertzloop.studies.budget.probability import Draws, probability
from hertzloop.studies.budget.real_plant import real_plant
from hertzloop.studies.budget.result import Baseline, BudgetResult, InPlant, nearest
from hertzloop.studies.budget.stability import linear_margin, stable_under
from hertzloop.studies.cases.evaluate import CaseTally, Pool, evaluate
from hertzloop.studies.cases.journal import FinishedCases
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.cases.rows import RunCases, check_all_ran, failed, metric_of


def budget(
    plan: BudgetPlan,
    finished: FinishedCases | None = None,
    on_progress: Callable[[float], None] = lambda share: None,
) -> BudgetResult:
    """Measure the budget of the law of a scene.

    Args:
        plan: What to search.
        finished: Cases that an earlier start has finished, if they are kept.
        on_progress: Called with the finished share of the limits.

    Raises:
        CaseFailed: the nominal case or one with drawn values failed in its run.
        SceneError: the nominal case, or a case with drawn values, was refused.
        WorkersLost: a worker process was lost.
    """
    with local_pool(plan.request.workers) as workers:
        return _budget(
            plan, workers if finished is None else finished.skipping_finished(workers), on_progress
        )


@dataclass(frozen=True)
class _Plant:
    """A plant to search: the span of its metrics, whether its own touch phase is simulated as long
    as the scene says, and keys of the real plant that the scene does not accept."""

    setup: Setup
    span: Span
    whole: bool = False
    left_out: tuple[str, ...] = ()

    def run(self, pool: Pool) -> RunCases:
        """Return a function that runs cases in this plant."""
        return lambda cases: evaluate(pool, self.setup, self.span, cases)


def _budget(plan: BudgetPlan, pool: Pool, on_progress: Callable[[float], None]) -> BudgetResult:
    setup, request, goals, tally = plan.setup, plan.request, plan.goals, CaseTally()
    counted = tally.counting(pool)
    scene = _Plant(setup, request.first_span, whole=True)
    plants = [scene]
    if request.span == "both":
        plants.append(_Plant(setup, OTHER[scene.span]))
    if request.with_real:
        changed, left_out = real_plant(setup)
        plants.append(_Plant(changed, scene.span, left_out=left_out))
    found = []
    for i, plant in enumerate(plants):
        part = lambda share, i=i: on_progress((i + share) / len(plants))  # noqa: E731
        found.append(_in_plant(plan, plant, counted, part))
    ideal, *others = found
    real = others.pop() if request.with_real else None
    other_span = OTHER[scene.span]
    (other_row,) = evaluate(counted, setup, other_span, [{}])
    own_db, other_db = ideal.nominal.metrics["plate_energy_db"], other_row["plate_energy_db"]
    why_no_other = ""
    if other_db is None:  # as of a loop that runs away after the first impact
        why_no_other = f"There is no plate energy {IN_WORDS[other_span]}: {other_row['status']}."
    elif abs(other_db - own_db) > MUCH_DB and not whole_run_known(setup):
        other_db, why_no_other = None, "Later impacts are not predictable."
    cases = tally.cases
    likely = None
    if plan.uncertain is not None:
        draws = Draws(plan.uncertain, request.within, request.most_cases)
        stable = stable_under(setup, ideal.margin)
        likely = probability(setup, goals, draws, scene.run(counted), stable)
    on_progress(1.0)
    return BudgetResult(
        scene=setup.scene.name,
        law=setup.scene.controller.law,
        span=scene.span,
        goals=goals,
        ideal=ideal,
        real=real,
        other=others[0] if others else None,
        other_db=other_db,
        why_no_other=why_no_other,
        probability=likely,
        cases=cases,
        all_cases=tally.cases,
        failed=tuple(str(row["status"]) for row in failed(tally.without_result)),
    )


def _in_plant(
    plan: BudgetPlan, plant: _Plant, pool: Pool, on_progress: Callable[[float], None]
) -> InPlant:
    """Measure the effect and the limits of the law in one plant."""
    setup, run = plant.setup, plant.run(pool)
    effort = effort_of(setup, plan.request.quick, plant.span)
    nominal = nominal_of(run, setup, plan.goals, effort, plant.whole)
    margin = linear_margin(setup)
    problem = LimitProblem(setup, margin, plan.goals, effort)
    limits = limits_of(problem, plan.request.only, run, on_progress)
    first = next((limit.quantity for limit in nearest(limits)), None)
    return InPlant(plant.span, nominal, margin, limits, first, _deepest_m(setup), plant.left_out)


def _deepest_m(setup: Setup) -> float | None:
    """Return the penetration without control that Hertz's law gives for the peak force, m; None for
    a law that senses another quantity."""
    if setup.scene.sensors.quantity != "xi":
        return None
    peak_n = uncontrolled(setup, "impact").peak_force_n
    return float((peak_n / setup.mechanics.contact.stiffness) ** (2.0 / 3.0))


def nominal_of(
    run: RunCases, setup: Setup, goals: Sequence[Goal], effort: SearchEffort, whole: bool
) -> Baseline:
    """Measure what a law does in a scene as it is.

    Args:
        run: Returns the rows of cases, in their order.
        setup: The scene with its law.
        goals: What the law has to do.
        effort: The touch phases, and the length of a run.
        whole: Whether the scene's own touch phase is simulated as long as the scene says, as
            `hertzloop run` does.

    Raises:
        CaseFailed: a case failed in its run.
        SceneError: a case was refused.
    """
    lasts = lasting(effort.long_s)
    at = [lasts | {"run.touch_phase": phase} for phase in effort.phases]
    own, *rows = run([{} if whole else lasts, *at])
    check_all_ran([own, *rows], f"{setup.scene.name}: the law cannot be run in this scene")
    worst = max(rows, key=lambda row: worst_excess(goals, row))
    return Baseline(
        metrics={name: metric_of(own, name) for name in METRICS},
        over_phases={name: spread_of([metric_of(row, name) for row in rows]) for name in METRICS},
        met=all(all_met(goals, row) for row in rows),
        unstable=any(row["state"] == CaseState.UNSTABLE for row in (own, *rows)),
        missed=tuple(str(goal) for goal in goals if not goal.met(worst)),
    )
