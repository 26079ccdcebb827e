"""The limit of jitter against the worst sequence of latencies, and its replay."""

import re

import numpy as np
import pytest

from hertzloop.scene.setup import load
from hertzloop.studies.budget.goal import parse_goal
from hertzloop.studies.budget.worst_limit import objective_of, worst_limit
from tests.commands import invoke
from tests.studies.worst.made_up import SCENE, made_up, simulated

GOAL = parse_goal("plate_energy_db <= 2")


def test_the_limit_of_a_sum():
    setup = load("aluminium-3mm", SCENE)
    weights = np.zeros(30)
    weights[[2, 9, 21]] = 0.2  # 0.6 dB a microsecond, and 2 dB are allowed
    found = worst_limit(setup, [GOAL], 20, [0.0], made_up(weights))
    assert found.tolerated_us == 3.0
    assert found.worst is not None
    assert found.worst.metrics["plate_energy_db"] == pytest.approx(2.4)
    assert worst_limit(setup, [GOAL], 3, [0.0], made_up(weights)).worst is None
    assert worst_limit(setup, [GOAL], 3, [0.0], made_up(weights + 9.0)).tolerated_us == 0.0


def test_a_strict_goal_that_is_just_reached_is_missed():
    setup = load("aluminium-3mm", SCENE)
    weights = np.zeros(30)
    weights[4] = 0.5
    for goal, tolerated_us in (("plate_energy_db <= 2", 4.0), ("plate_energy_db < 2", 3.0)):
        found = worst_limit(setup, [parse_goal(goal)], 8, [0.0], made_up(weights))
        assert found.tolerated_us == tolerated_us


def test_a_sequence_that_the_scene_refuses_is_not_the_worst():
    objective = objective_of([GOAL])
    refused = {"plate_energy_db": None, "status": "no", "state": "not run"}
    assert objective.excess(refused) == -np.inf
    assert not objective.missed(refused)
    unstable = refused | {"state": "unstable"}
    assert objective.excess(unstable) == np.inf
    assert objective.missed(unstable)


def test_the_command_writes_a_trace_that_run_replays(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hertzloop.studies.worst.search.MOST_CASES", 200)
    options = ["--quick", "--no-real-plant", "--only", "jitter_us", "--workers", "1", "--worst"]
    options += ["--set", SCENE[0], "--goal", "plate_energy_db <= 2"]
    done = invoke(["budget", "aluminium-3mm", *options])
    assert done.exit_code == 0, done.output
    text = " ".join(done.output.split())
    worst = float(re.search(r"plate_energy_db is ([\d.]+)", text)[1])  # type: ignore[index]
    trace = tmp_path / "aluminium-3mm-worst-latencies.csv"
    phase = float(re.search(r"run.touch_phase=([\d.]+)", text)[1])  # type: ignore[index]
    again = {"controller.latency_trace": str(trace), "run.touch_phase": phase}
    setup = load("aluminium-3mm", [*SCENE, *(f"{key}={value}" for key, value in again.items())])
    (row,) = simulated(setup, [{}])
    assert row["plate_energy_db"] == pytest.approx(worst, abs=5e-3)
    assert worst > 2.0
    trace.write_text("mine")
    assert invoke(["budget", "aluminium-3mm", *options]).exit_code == 2
    assert trace.read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--set", "controller.jitter_us=3"], "has latencies of its own"),
        (["--set", "controller.clock_ppm=3"], "has latencies of its own"),
        (["--only", "bits"], "Add --only jitter_us"),
    ],
)
def test_refused(options, message):
    done = invoke(["budget", "aluminium-3mm", "--worst", *options])
    assert done.exit_code == 2
    assert message in " ".join(done.output.split())
