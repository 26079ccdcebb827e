"""The worst sequence of latencies: found by search, worse than random draws, and replayed."""

import re
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hertzloop.scene.setup import Setup, load
from hertzloop.studies.budget.goal import parse_goal
from hertzloop.studies.budget.worst_sequence import (
    MOST_CASES,
    LatencyWindow,
    case_of,
    window_of,
    worst_limit,
    worst_sequence,
)
from hertzloop.studies.cases.evaluate import run_cases
from tests.commands import invoke

SCENE = ["run.duration_s=0.0016"]
GOAL = parse_goal("plate_energy_db <= 2")


def simulated(setup: Setup, cases: list[dict[str, Any]]) -> list[dict[str, Any]]:
    rows = run_cases(setup, "impact", list(enumerate(cases)))
    return sorted(rows, key=lambda row: int(row["case"]))


def made_up(setup: Setup, weights: np.ndarray) -> Any:
    """Rows of cases whose plate energy is a weighted sum of the last latencies."""

    def run(cases: list[dict[str, Any]]) -> list[dict[str, Any]]:
        rows = []
        for case in cases:
            last = np.array(case.get("controller.latency_trace", [0.0]))[-len(weights) :]
            energy = float(np.sum(weights[-len(last) :] * last))
            rows.append({"plate_energy_db": energy, "status": "", "steps": 1030, "contact_us": 30})
        return rows

    return run


def test_the_corner_of_a_sum_is_found() -> None:
    setup = load("aluminium-3mm", SCENE)
    weights = np.random.default_rng(3).standard_normal(30)
    found = worst_sequence(setup, [GOAL], 4, [0.0], made_up(setup, weights))
    assert found.metrics["plate_energy_db"] == pytest.approx(4.0 * weights[weights > 0.0].sum())
    assert found.cases <= MOST_CASES + 1


def test_the_limit_of_a_sum() -> None:
    setup = load("aluminium-3mm", SCENE)
    weights = np.zeros(30)
    weights[[2, 9, 21]] = 0.2  # 0.6 dB a microsecond, and 2 dB are allowed
    found = worst_limit(setup, [GOAL], 20, [0.0], made_up(setup, weights))
    assert found.tolerated_us == 3.0
    assert found.worst is not None
    assert found.worst.metrics["plate_energy_db"] == pytest.approx(2.4)
    assert worst_limit(setup, [GOAL], 3, [0.0], made_up(setup, weights)).worst is None
    assert worst_limit(setup, [GOAL], 3, [0.0], made_up(setup, weights + 9.0)).tolerated_us == 0.0


def test_a_strict_goal_that_is_just_reached_is_missed() -> None:
    setup = load("aluminium-3mm", SCENE)
    weights = np.zeros(30)
    weights[4] = 0.5
    for goal, tolerated_us in (("plate_energy_db <= 2", 4.0), ("plate_energy_db < 2", 3.0)):
        found = worst_limit(setup, [parse_goal(goal)], 8, [0.0], made_up(setup, weights))
        assert found.tolerated_us == tolerated_us


@pytest.mark.parametrize("count", [1, 7, 40])
def test_blocks_cover_a_window(count: int) -> None:
    blocks = LatencyWindow(5, 15, 60).blocks(count)
    ends = [0, *(end for _, end in blocks)]
    assert [first for first, _ in blocks] == ends[:-1]
    assert ends[-1] == 55
    lengths = [end - first for first, end in blocks]
    assert lengths[0] <= lengths[-1]


def test_it_is_worse_than_random_draws() -> None:
    setup = load("aluminium-3mm", SCENE)
    found = worst_sequence(setup, [GOAL], 3, [0.0], lambda cases: simulated(setup, cases))
    (nominal,) = simulated(setup, [case_of([0.0], 0.0)])
    window, draw = window_of(setup, 3, nominal), np.random.default_rng(1)
    cases = [
        case_of([0.0] * window.first + list(map(float, draw.integers(0, 4, window.count))), 0.0)
        for _ in range(200)
    ]
    drawn = [row["plate_energy_db"] for row in simulated(setup, cases)]
    assert max(drawn) <= found.metrics["plate_energy_db"]  # type: ignore[operator]


def test_it_is_as_bad_as_the_worst_of_all_few() -> None:
    """All sequences of two samples with three latencies each, by brute force."""
    setup = load("aluminium-3mm", [*SCENE, "sensors.every_steps=20"])
    found = worst_sequence(setup, [GOAL], 2, [0.0], lambda cases: simulated(setup, cases))
    (nominal,) = simulated(setup, [case_of([0.0], 0.0)])
    window = window_of(setup, 2, nominal)
    few = product((0.0, 1.0, 2.0), repeat=3)
    cases = [case_of([0.0] * window.first + list(one) + [0.0] * 9, 0.0) for one in few]
    worst = max(row["plate_energy_db"] for row in simulated(setup, cases))
    assert worst <= found.metrics["plate_energy_db"] + 1e-12  # type: ignore[operator]


def test_the_command_writes_a_trace_that_run_replays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
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
def test_refused(options: list[str], message: str) -> None:
    done = invoke(["budget", "aluminium-3mm", "--worst", *options])
    assert done.exit_code == 2
    assert message in " ".join(done.output.split())
