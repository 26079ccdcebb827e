"""Goals, and the limits that a search finds."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from hertzloop.results.cases import CaseState
from hertzloop.scene.setup import load
from hertzloop.studies.budget.budget import budget
from hertzloop.studies.budget.effort import SearchEffort, effort_of, variants
from hertzloop.studies.budget.goal import METRICS, GoalError, all_met, parse_goal
from hertzloop.studies.budget.limit_search import limit_of
from hertzloop.studies.budget.limits import Boundary, BudgetQuantity
from hertzloop.studies.budget.plan import BudgetPlan, plan_budget
from hertzloop.studies.budget.plant_limits import side_by_side
from hertzloop.studies.budget.quantities import quantities_of
from hertzloop.studies.budget.request import BudgetRequest
from hertzloop.studies.cases.evaluate import evaluate
from tests.commands import call
from tests.hertzloop.scenes import json_in

SHORT = ["run.duration_s=0.0016", "controller.law=force_feedback"]
GOAL = parse_goal("plate_energy_db <= -0.1")


def row(value, state=CaseState.METRICS):
    """A row of a case with one metric."""
    bad = state is not CaseState.METRICS
    return {
        "plate_energy_db": None if bad else value,
        "status": "no" if bad else "",
        "state": state.value,
    }


def found_by(holds, quantity, search=None):
    """The limit where `holds(value, case)` decides, and the values asked for."""
    asked = []

    def run(cases):
        asked.extend(cases)
        return [row(-1.0 if holds(case["a.b"], case) else 1.0) for case in cases]

    search = search or SearchEffort((0.1, 0.5, 0.9), (1,), 6)
    (limit,) = side_by_side([limit_of(quantity, [GOAL], search)], run)
    assert limit.cases == len(asked)
    return limit, asked


def test_a_goal_is_read_and_says_whether_a_row_meets_it():
    goal = parse_goal("plate_energy_db<=-3")
    assert str(goal) == "plate_energy_db <= -3"
    assert goal.met(row(-3.0))
    assert not goal.met(row(-2.99))
    assert not parse_goal("plate_energy_db < -3").met(row(-3.0))
    assert parse_goal("plate_energy_db >= 1").met(row(1.5))
    assert not goal.met(row(-9.0, CaseState.UNSTABLE))
    assert goal.excess(row(math.nan)) == math.inf
    assert "digest" not in METRICS
    assert "pumps" not in METRICS


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("plate_energi_db <= 1", "Did you mean plate_energy_db"),
        ("plate_energy_db = 1", "must be"),
        ("plate_energy_db <= x", "must be"),
        ("plate_energy_db <= 1.2.3", "must be"),
        ("", "must be"),
    ],
)
def test_a_goal_that_cannot_be_read_is_refused(text, word):
    with pytest.raises(GoalError, match=word):
        parse_goal(text)


LATENCY = BudgetQuantity("latency_us", "a.b", "us", tuple(range(100)))


def test_ends_of_the_range_are_told_apart():
    whole, _ = found_by(lambda *_: True, replace(LATENCY, end="it is as long as the contact"))
    assert (whole.boundary, whole.value, whole.share) == (Boundary.NO_LIMIT, None, None)
    assert whole.reason == "at 99 us it is as long as the contact."
    never, _ = found_by(lambda *_: False, LATENCY)
    assert (never.boundary, never.value, never.share) == (Boundary.NEVER, None, None)
    bits = BudgetQuantity("bits", "a.b", "bits", ("ideal", 3, 2, 1))
    ideal, _ = found_by(lambda value, _: value == "ideal", bits)
    assert (ideal.boundary, ideal.value, ideal.first_failure) == (Boundary.IDEAL_ONLY, None, 3)


@pytest.mark.parametrize("last", [150, 151, 998])
def test_a_search_goes_on_beyond_the_usual_range_until_the_goal_fails(last):
    quantity = BudgetQuantity("latency_us", "a.b", "us", tuple(range(1000)), "it ends", 100)
    limit, asked = found_by(lambda value, _: value <= last, quantity)
    assert (limit.value, limit.first_failure, limit.interval) == (last, last + 1, True)
    assert limit.searched == (0.0, 999.0)
    assert len(quantity.within(limit).values) == 1000
    assert len(asked) < 120
    usual, _ = found_by(lambda value, _: value <= 60, quantity)
    assert (usual.value, usual.searched, usual.share) == (60, (0.0, 100.0), 0.6)
    assert quantity.within(usual).values == tuple(range(101))
    whole, _ = found_by(lambda *_: True, quantity)
    assert (whole.boundary, whole.searched) == (Boundary.NO_LIMIT, (0.0, 999.0))


LATE_LAW = """
from typing import NamedTuple

SENSES = "velocity"


class Constants(NamedTuple):
    late: float


def prepare(keys, about):
    late = float(about.loop_delay_steps > 4)
    {refusal}
    return Constants(late)


def command(p, s, samples, i):
    return 1.0 / (1.0 - p.late) - 1.0 - 20.0 * samples[i]
"""


@pytest.mark.parametrize(
    ("refusal", "boundary", "exit_code"),
    [("", "failed", 1), ("if late: raise ValueError('too late')", "refused", 0)],
)
def test_a_bug_of_the_law_and_its_refusal_are_told_apart(
    tmp_path, monkeypatch, refusal, boundary, exit_code
):
    monkeypatch.chdir(tmp_path)
    Path("late.py").write_text(LATE_LAW.replace("{refusal}", refusal))
    options = ["--quick", "--no-real-plant", "--only", "latency_us", "--workers", "1"]
    options += ["--set", SHORT[0], "--law", "late.py", "--goal", "plate_energy_db <= 99"]
    done = call("budget", "aluminium-3mm", *options, "--json", "found.json")
    assert done.exit_code == exit_code, done.output
    limit = json_in("found.json")["limits"]["latency_us"]
    assert (limit["boundary"], limit["value"]) == (boundary, 3.0)
    assert ("ZeroDivisionError" in done.output) == (boundary == "failed")


def test_a_refused_quantity_has_one_reason_and_no_values():
    setup = load("offcentre-6mm", [*SHORT])
    (mass,) = (q for q in quantities_of(setup) if q.name == "mass_kg")
    assert next(q.unit for q in quantities_of(setup) if q.name == "noise") == "N rms"

    def run(cases):
        return [
            row(-1.0) if case[mass.key] == 0.0 else row(0.0, CaseState.NOT_RUN) for case in cases
        ]

    (limit,) = side_by_side([limit_of(mass, [GOAL], SearchEffort((0.5,), (1,), 6))], run)
    assert (limit.boundary, limit.value) == (Boundary.IMPOSSIBLE, None)
    assert (limit.interval, limit.holds_again) == (True, ())
    assert limit.reason == "actuator.mass_kg: no"


def test_every_phase_and_seed_counts():
    quantity = BudgetQuantity("noise", "a.b", "rms", tuple(range(100)), by_chance=True)
    search = SearchEffort((0.1, 0.9), (4, 5), 6)
    assert len(variants(quantity, search)) == 4

    def holds(value, case):
        return value <= (20 if case["run.touch_phase"] == 0.9 and case["run.seed"] == 5 else 60)

    assert found_by(holds, quantity, search)[0].value == 20
    for phase in (0.1, 0.5, 0.9):
        limit, _ = found_by(
            lambda value, case, at=phase: value <= 62 or case["run.touch_phase"] != at, LATENCY
        )
        assert (limit.value, limit.interval) == (62.0, True)


def test_a_region_that_is_not_an_interval_is_reported():
    quantity = replace(LATENCY, values=tuple(range(101)))
    limit, _ = found_by(lambda value, _: value <= 10 or value >= 70, quantity)
    assert (limit.value, limit.interval) == (10, False)
    assert limit.holds_again == (80.0, 100.0)
    never, _ = found_by(
        lambda value, case: 5 <= value <= 40 or case["run.touch_phase"] != 0.9, LATENCY
    )
    assert (never.boundary, never.value) == (Boundary.NEVER, None)
    assert never.holds_again == (20.0, 40.0)


def test_a_loop_that_fails_late_is_found_by_the_longer_run():
    search = SearchEffort((0.5,), (1,), 6, short_s=0.001, long_s=0.01)
    limit, _ = found_by(
        lambda value, case: value <= (60 if case["run.duration_s"] < 0.005 else 33), LATENCY, search
    )
    assert limit.value == 33


def test_limits_agree_with_brute_force(pool):
    setup = load("aluminium-3mm", SHORT)
    search = effort_of(setup, True, "impact")
    asked = BudgetRequest(quick=True, with_real=False, only=("latency_us", "sampling_us"))
    found = budget(BudgetPlan(setup, (GOAL,), None, asked))
    for limit in found.ideal.limits:
        quantity = next(q for q in quantities_of(setup) if q.name == limit.quantity).within(limit)
        others = variants(quantity, search)
        cases = [{quantity.key: value} | one for value in quantity.values for one in others]
        rows = evaluate(pool, setup, "impact", cases)
        holds = [
            all(all_met([GOAL], r) for r in rows[i : i + len(others)])
            for i in range(0, len(rows), len(others))
        ]
        assert limit.value == quantity.reported(holds.index(False) - 1)
        if quantity.scan:
            again = [quantity.reported(i) for i, ok in enumerate(holds) if ok]
            assert list(limit.holds_again) == [x for x in again if x > limit.value]
        else:
            assert limit.cases < len(rows) / 3
    [nominal] = evaluate(pool, setup, "impact", [{}])
    assert found.as_data()["nominal"]["plate_energy_db"] == nominal["plate_energy_db"]


def test_the_limit_of_the_jitter_has_the_mean_latency(pool):
    asked = BudgetRequest(only=["jitter_us"], quick=True, with_real=False)
    (limit,) = budget(plan_budget(load("aluminium-3mm", SHORT), asked)).ideal.limits
    assert limit.value
    mean_us = float(limit.remark.removeprefix("mean latency ").removesuffix(" us"))
    assert 0.5 * limit.value < mean_us < limit.value
