"""Designs of sweeps: values of an axis, spread points, and what is refused."""

import numpy as np
import pytest

from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from hertzloop.studies.cases.axis import Axis, DesignError, axes_from, parse_axis
from hertzloop.studies.cases.design import Design, design_of

LONG = "9" * 4000
LAWS = "controller.law=slope_threshold,fade_out,predicted"


@pytest.mark.parametrize(
    ("over", "says"),
    [
        ([LONG], "invalid range"),
        (["controller.kappa=0:1:-1"], "Give a step above 0"),
        ([f"controller.kappa={'1' * 300}:0:1"], "the first number must be the lower"),
        ([f"controller.kappa={LONG},,"], "empty value"),
        (["controller.kappa=0:1e308:5e-324"], "has inf values; the limit is 10000000"),
        (["controller.latency_us=0:5"], "has no step"),
        (["controller.latency_us=0:inf:1"], "must consist of numbers"),
        (["controller.kappa=0:1:0.1", "controller.kappa=2"], "given twice"),
        (["controller.latncy_us=0:5:1"], "Did you mean latency_us"),
        (["controller.latency_us=0:1:0.5"], "controller.latency_us = 0.5: must be a whole number"),
        ([], "at least one --over"),
        (["controller.window_samples=2,3"], "has no effect on controller.law = 'slope_threshold'"),
        # The default is among the values, and the law that lacks the key is the last.
        ([LAWS, "controller.lead_us=0,1"], "has no effect on controller.law = 'predicted'"),
        (["controller.law=fade_out,off,predicted", "controller.kappa=0.5,0.6"], "law = 'off'"),
        (
            ["contact.restitution=0.5,0.6"],
            "has no effect without contact.damping = 'hunt_crossley'",
        ),
    ],
)
def test_what_cannot_be_swept_is_refused_shortly(over, says):
    with pytest.raises((DesignError, SceneError), match=says) as refused:
        design_of(load("aluminium-3mm"), axes_from(over), "grid", 0, 1)
    assert len(str(refused.value)) < 1000


def test_a_case_between_the_ends_of_an_axis_says_itself_that_it_cannot_be():
    over = ["controller.latency_us=0,1,1.5,2", "run.step_ns=1000"]
    assert design_of(load("aluminium-3mm"), axes_from(over), "grid", 0, 1)


def test_laws_may_be_swept_with_the_keys_that_all_of_them_have():
    scene = load("aluminium-3mm", ["controller.lead_us=1"])  # of the scene's own law
    made = design_of(scene, axes_from([LAWS, "controller.kappa=0.5,0.6"]), "grid", 0, 1)
    varied = [scene.vary(case).scene.controller.keys for case in made.cases()]
    assert [getattr(table, "lead_us", None) for table in varied] == [1.0, 1.0, 1.0, 1.0, None, None]


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("controller.latency_us=0:6:2", (0, 2, 4, 6)),
        ("controller.kappa=0:0.3:0.1", (0.0, 0.1, 0.2, 0.3)),
        ("sensors.bits=8,ideal", (8, "ideal")),
        ("plate.contact_point_m=[0.1, 0.2],[0.25, 0.25]", ([0.1, 0.2], [0.25, 0.25])),
        ("sensors.bits=12", (12,)),
    ],
)
def test_values_of_an_axis(text, values):
    assert parse_axis(text).values == values


@pytest.mark.parametrize("kind", ["lhs", "sobol"])
def test_spread_points_fill_every_axis_and_are_repeatable(kind):
    axes = (Axis("controller.kappa", (), 0.0, 2.0), Axis("sensors.bits", (4, 8, 12, 16)))
    cases = Design(axes, kind, 64, 3).cases()
    assert cases == Design(axes, kind, 64, 3).cases()
    assert cases != Design(axes, kind, 64, 4).cases()
    kappas = np.sort([case["controller.kappa"] for case in cases])
    assert np.all(np.abs(kappas - np.linspace(0.0, 2.0, 64)) < 0.07)
    assert [sum(c["sensors.bits"] == b for c in cases) for b in (4, 8, 12, 16)] == [16] * 4


def test_spread_points_are_values_that_their_keys_can_have():
    scene = load("aluminium-3mm", ["run.step_ns=500"])
    over = [
        "sensors.bits=4:9",
        "controller.latency_us=1:3",
        "run.seed=1:4",
        "controller.kappa=0:2",
        "controller.law=fade_out",
        "controller.fade_us=0:1",
    ]
    cases = design_of(scene, axes_from(over), "lhs", 60, 1).cases()
    for case in cases:
        scene.vary(case)
    found = {key: sorted({case[key] for case in cases}) for key in cases[0]}
    assert found["sensors.bits"] == [4, 5, 6, 7, 8, 9]
    assert found["controller.latency_us"] == [1.0, 1.5, 2.0, 2.5, 3.0]
    assert found["run.seed"] == [1, 2, 3, 4]
    assert len(found["controller.kappa"]) == 60
    assert found["controller.fade_us"] == [0.0, 0.5, 1.0]  # of a law that the scene has not


def test_a_case_is_the_scene_with_its_keys():
    scene = load("aluminium-3mm")
    same = load("aluminium-3mm", ["controller.law=velocity_feedback", "controller.kappa=0.5"])
    assert scene.vary({"controller.law": "velocity_feedback", "controller.kappa": 0.5}) == same
