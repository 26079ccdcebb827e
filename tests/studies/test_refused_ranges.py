"""Ranges of a sweep that are refused: in one sentence, whatever they hold."""

import pytest

from hertzloop.scenes.scene import SceneError, load
from studies.sweeps.design import DesignError, make_design

LONG = "9" * 4000


@pytest.mark.parametrize(
    ("over", "says"),
    [
        (LONG, "is no range"),
        (f"{LONG}.{LONG}", "is no range"),
        (f"controller.kappa={LONG}:x:1", "no range of numbers"),
        (f"{LONG}=a:b", "no range of numbers"),
        (f"controller.kappa=1{'0' * 400}:1{'0' * 401}:1", "no range of numbers"),
        (f"controller.kappa=0:1:-1{'0' * 300}", "must be above 0"),
        (f"controller.kappa={'1' * 300}:0:1", "runs backwards"),
        (f"controller.kappa={LONG},,", "empty value"),
        (f"sensors.bits={'z' * 4000}", "value 'zzz"),
        (f"{LONG}=1,2", "is no scene key"),
        ("controller.kappa=0:1e308:5e-324", "has inf values, the most is 10000000"),
        (f"controller.kappa=-1{'0' * 308}:1{'0' * 308}:1", "has inf values"),
        ("controller.kappa=0:1:0.00000001", r"has 1e\+08 values"),
    ],
)
def test_what_is_refused_is_echoed_shortly(over: str, says: str) -> None:
    with pytest.raises((DesignError, SceneError), match=says) as refused:
        make_design(load("aluminium-3mm"), [over], "grid", 0, 1)
    assert len(str(refused.value)) < 1000
