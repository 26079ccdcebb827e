"""Sentences of a budget on the screen."""

from dataclasses import fields, replace

import pytest

from hertzloop.cli.budget import noise_lines, verdict_line, wider_lines
from hertzloop.studies.budget.goal import Goal
from hertzloop.studies.budget.limits import Boundary, BudgetLimit
from hertzloop.studies.budget.result import Baseline, BudgetResult, InPlant

NOISE = BudgetLimit(
    "noise", "sensors.noise_rms", "m rms", Boundary.FOUND, 1e-5, 1.1e-5, (0.0, 1e-3), True, (), 0.5,
    9,
)  # fmt: skip
MET = Baseline({}, {}, True, False, ())
SCENE = InPlant("impact", MET, None, (NOISE,), "noise", 9e-6)


def _result(real: InPlant | None) -> BudgetResult:
    goal = Goal("plate_energy_db", "<=", -3.0)
    named = {"scene": "s", "law": "mine", "span": "impact", "goals": (goal,), "ideal": SCENE}
    others = dict.fromkeys(one.name for one in fields(BudgetResult))
    return BudgetResult(**others | named | {"real": real})


def test_noise_as_large_as_the_penetration_is_said_to_be_no_demand():
    (line,) = noise_lines("the scene", SCENE)
    assert "up to 10 um rms, is as large as the penetration itself (9 um without control)" in line
    assert noise_lines("the scene", replace(SCENE, deepest_m=1.1e-5)) == []
    assert noise_lines("the scene", replace(SCENE, deepest_m=None)) == []


@pytest.mark.parametrize(
    ("met", "says"),
    [
        (True, "at every touch phase in the scene and in the real plant; noise binds first: up to"),
        (False, "at every touch phase in the scene, but not in the real plant; noise binds"),
    ],
)
def test_the_verdict_names_goal_plants_and_first_limit(met, says):
    found = _result(replace(SCENE, nominal=replace(MET, met=met)))
    assert f"the law mine meets its goal plate_energy_db <= -3 {says}" in verdict_line(found)


def test_a_real_plant_that_tolerates_more_is_explained():
    wide = replace(SCENE, limits=(replace(NOISE, value=2e-5),))
    assert "tolerates more of noise (up to 20 um rms against up to 10 um rms)" in wider_lines(
        _result(wide)
    )[0]  # fmt: skip
    assert wider_lines(_result(SCENE)) == []
