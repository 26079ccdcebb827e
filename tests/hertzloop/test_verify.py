"""The check after a run: it sees what a finer model would have changed."""

import pytest

from hertzloop.compiled import simulate
from hertzloop.scene import SceneError, load
from hertzloop.verify import Verification, verify

SHORT = ["run.duration_s=0.0015", "controller.law=off"]


def checked(*settings: str) -> Verification:
    scene = load("aluminium-3mm", [*SHORT, *settings])
    found = verify(scene, simulate(scene).rows)
    assert found is not None
    return found


def test_a_run_that_meets_its_accuracy() -> None:
    assert checked("run.accuracy=1e-3").largest < 1e-3
    assert checked("run.accuracy=1e-2").largest < 1e-2


def test_more_modes_and_a_smaller_step_change_less() -> None:
    coarse, fine = checked("run.accuracy=1e-1"), checked("run.accuracy=1e-3")
    assert fine.largest < 0.1 * coarse.largest
    second_order = checked("run.scheme=discrete_gradient", "run.accuracy=1e-9")
    assert second_order.largest > 2.0 * fine.largest


def test_recorded_forces_act_at_their_times() -> None:
    """With the law active the same forces act on both models: changes stay small."""
    found = checked("controller.law=slope_threshold", "controller.latency_us=3")
    assert found.penetration < 1e-3
    assert found.rebound_speed < 1e-3


def test_nothing_to_verify() -> None:
    scene = load("aluminium-3mm", ["run.duration_s=0.0005"])
    assert verify(scene, simulate(scene).rows) is None
    published = load("thesis-aluminium")
    with pytest.raises(SceneError, match="does not converge"):
        verify(published, simulate(published).rows)


def test_a_force_that_still_pushes_when_the_contact_ends_is_compared_over_the_same_time() -> None:
    """Work is counted from row to row; half a step more on one side was 1 % of the energy here."""
    scene = load("aluminium-3mm", ["run.duration_s=0.0013"])
    found = verify(scene, simulate(scene).rows)
    assert found is not None
    assert found.plate_energy < 3e-3
