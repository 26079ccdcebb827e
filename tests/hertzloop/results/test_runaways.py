"""A loop that runs away is unstable, not a case that failed; its numbers stay finite. A wrong law
fails, and a force that is known ahead can do neither."""

import re

import numpy as np
import pytest

from hertzloop.loop import events as loop_events
from hertzloop.loop.simulate import simulate
from hertzloop.plant.actuator_kernels import MOST_N
from hertzloop.plant.time_series import F_A
from hertzloop.results.cases import CaseState, UnstableLoop, metrics_of_case
from hertzloop.scene.errors import SceneError
from hertzloop.studies.cases.evaluate import run_case
from hertzloop.studies.cases.rows import without_result
from tests.hertzloop.scenes import aluminium_3mm, recorded

RUN = ["run.accuracy=0.05", "run.duration_s=0.004"]
AWAY = [("velocity_feedback", 3.0), ("acceleration_feedback", -2.0)]


@pytest.mark.parametrize(("law", "kappa"), AWAY)
def test_a_runaway_is_an_unstable_case(law, kappa):
    scene = aluminium_3mm(*RUN, f"controller.law={law}", f"controller.kappa={kappa}")
    with pytest.raises(UnstableLoop, match="the closed loop is unstable: the actuator exchanges"):
        metrics_of_case(scene, "run")
    row = run_case(scene, "run", 0, {})
    assert row["state"] == CaseState.UNSTABLE
    assert row["status"].startswith("the closed loop is unstable")
    assert not without_result([row])
    run = simulate(scene)
    assert np.isfinite(run.truth).all()
    assert abs(run.truth[F_A]).max() == MOST_N
    assert abs(run.balance.energy_residual) < 1e-9


def test_events_that_are_too_many_are_counted(tmp_path, monkeypatch):
    """However the samples come in blocks."""
    monkeypatch.setattr(loop_events, "MOST", 1)
    scene = aluminium_3mm(*RUN)
    told = []
    for compiled in (True, False):
        file = tmp_path / f"{compiled}.mcap"
        events = recorded(scene, file, compiled).events
        told.append([(event.name, event.time_ns, event.message) for event in events])
    assert sorted(told[0]) == sorted(told[1])
    for name in ("plant", "controller"):
        *listed, last = [event for event in told[0] if event[0] == name]
        assert len(listed) == 1
        assert last[1] == scene.steps * scene.step_ns - scene.step_ns
        assert re.fullmatch(r"\d+ further events are not listed", last[2])


@pytest.mark.parametrize("force_n", [-50.0, 50.0])
def test_a_constant_force_answers_nothing_and_cannot_run_away(force_n):
    """Its metrics stand however much energy it puts in; it has no kappa to change."""
    keys = [
        *RUN,
        "controller.law=constant",
        f"controller.force_n={force_n}",
        "controller.duration_us=2500",
    ]
    found = metrics_of_case(aluminium_3mm(*keys), "run")
    assert found.plate_energy_db > 10.0
    assert not found.pumps
    with pytest.raises(SceneError, match="law = 'constant', whose keys are: delay_us, lead_us"):
        aluminium_3mm(*keys, "controller.kappa=-2.0")
