"""Ranges of a sweep that are refused: in one sentence, whatever they hold."""

import pytest

from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from hertzloop.studies.sweeps.design import DesignError, make_design

LONG = "9" * 4000


@pytest.mark.parametrize(
    ("over", "says"),
    [
        (LONG, "invalid range"),
        (f"{LONG}.{LONG}", "invalid range"),
        (f"controller.kappa={LONG}:x:1", "must consist of numbers"),
        (f"{LONG}=a:b", "must consist of numbers"),
        (f"controller.kappa=1{'0' * 400}:1{'0' * 401}:1", "must consist of numbers"),
        (f"controller.kappa=0:1:-1{'0' * 300}", "Give a step above 0"),
        (f"controller.kappa={'1' * 300}:0:1", "the first number must be the lower"),
        (f"controller.kappa={LONG},,", "empty value"),
        (f"sensors.bits={'z' * 4000}", "value 'zzz"),
        (f"{LONG}=1,2", "unknown scene key"),
        ("controller.kappa=0:1e308:5e-324", "has inf values; the limit is 10000000"),
        (f"controller.kappa=-1{'0' * 308}:1{'0' * 308}:1", "has inf values"),
        ("controller.kappa=0:1:0.00000001", r"has 1e\+08 values"),
    ],
)
def test_what_is_refused_is_echoed_shortly(over: str, says: str) -> None:
    with pytest.raises((DesignError, SceneError), match=says) as refused:
        make_design(load("aluminium-3mm"), [over], "grid", 0, 1)
    assert len(str(refused.value)) < 1000


LAWS = "controller.law=slope_threshold,fade_out,predicted"


@pytest.mark.parametrize(
    ("over", "says"),
    [
        (["controller.window_samples=2,3"], "has no effect on controller.law = 'slope_threshold'"),
        # The default is among the values, and the law that lacks the key is the last.
        ([LAWS, "controller.lead_us=0,1"], "has no effect on controller.law = 'predicted'"),
        (["controller.lead_us=0:2:1", LAWS], "has no effect on controller.law = 'predicted'"),
        (["controller.law=fade_out,off,predicted", "controller.kappa=0.5,0.6"], "law = 'off'"),
        (["contact.restitution=0.5,0.6"], "has no effect with contact.damping = 'none'"),
    ],
)
def test_an_axis_without_effect_on_one_of_the_laws_is_refused(over: list[str], says: str) -> None:
    with pytest.raises(SceneError, match=says):
        make_design(load("aluminium-3mm"), over, "grid", 0, 1)


def test_laws_may_be_swept_with_the_keys_that_all_of_them_have() -> None:
    scene = load("aluminium-3mm", ["controller.lead_us=1"])  # of the scene's own law
    made = make_design(scene, [LAWS, "controller.kappa=0.5,0.6"], "grid", 0, 1)
    varied = [scene.vary(case).scene.controller.keys for case in made.cases()]
    assert [getattr(table, "lead_us", None) for table in varied] == [1.0, 1.0, 1.0, 1.0, None, None]
