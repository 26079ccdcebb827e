"""The worst latencies of the cases of a sweep: columns, trace, resumption, Python, refusals."""

import json
import shlex
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import hertzloop
from hertzloop.results.cases import metrics_of_case
from hertzloop.scene.setup import load
from hertzloop.studies.cases.evaluate import Numbered
from hertzloop.studies.sweep.plan import plan_sweep
from hertzloop.studies.sweep.request import SweepRequest
from hertzloop.studies.sweep.results_file import read_results
from hertzloop.studies.sweep.sweep import sweep
from hertzloop.studies.worst.of_case import run_cases_with_worst
from tests.commands import invoke

SCENE = ["run.duration_s=0.0016"]
WORDS = ["sweep", "aluminium-3mm", "--set", SCENE[0], "--workers", "1"]
WORDS += ["--worst", "plate_energy_db"]


@pytest.fixture
def few_cases(monkeypatch):
    monkeypatch.setattr("hertzloop.studies.worst.search.MOST_CASES", 60)


@pytest.mark.usefixtures("few_cases")
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_command_writes_columns_and_a_trace_that_run_replays(tmp_path, monkeypatch, suffix):
    monkeypatch.chdir(tmp_path)
    words = [*WORDS, "--over", "controller.jitter_us=0,2,5", "-o", f"r{suffix}", "--json", "r.json"]
    done = invoke(words)
    assert done.exit_code == 0, done.output
    rows, _ = read_results(Path(f"r{suffix}"))
    without, small, large = rows
    assert (without["worst_plate_energy_db"], without["worst_cases"]) == (None, None)
    assert without["worst_latencies_us"] is None
    assert small["worst_plate_energy_db"] < large["worst_plate_energy_db"]
    for row in (small, large):
        assert row["plate_energy_db"] < row["worst_plate_energy_db"]
        assert row["worst_cases"] == 60
        assert set(row["worst_latencies_us"]) <= set(range(6))
    told = json.loads(Path("r.json").read_text())["worst"]
    assert (told["case"], told["cases"]) == (2, 120)
    assert told["value"] == large["worst_plate_energy_db"]
    command = shlex.split(" ".join(done.output.split()).partition("See it: ")[2])
    settings = [value for name, value in pairwise(command) if name == "--set"]
    replay = load(command[2], settings)
    assert metrics_of_case(replay).plate_energy_db == large["worst_plate_energy_db"]
    again = invoke(words)
    assert "has the results of this sweep" in again.stderr
    assert again.stdout.splitlines()[-2:] == done.stdout.splitlines()[-2:]
    Path("r-worst-latencies.csv").write_text("mine")
    assert invoke([*words, "--overwrite"]).exit_code == 2
    assert Path("r-worst-latencies.csv").read_text() == "mine"


class _Killed(Exception):
    """As if the process had been killed."""


@pytest.mark.usefixtures("few_cases")
def test_a_killed_search_continues_with_the_next_case(tmp_path):
    setup = load("aluminium-3mm", SCENE)
    request = SweepRequest(["controller.jitter_us=1:3:1"], workers=1, worst="rebound_percent")
    plan = plan_sweep(setup, request)
    whole, out = tmp_path / "whole.csv", tmp_path / "r.csv"
    sweep(plan, whole)

    def kill(finished: int) -> None:
        if finished == 1:
            raise _Killed

    with pytest.raises(_Killed):
        sweep(plan, out, on_progress=kill)
    assert sweep(plan, out).ran == 2
    assert out.read_bytes() == whole.read_bytes()


@pytest.mark.usefixtures("few_cases")
def test_a_loop_that_some_latencies_make_unstable_is_the_worst():
    settings = ["run.accuracy=0.05", "controller.law=velocity_feedback", "run.duration_s=0.01"]
    setup = load("aluminium-20mm", [*settings, "controller.kappa=1.2", "controller.jitter_us=20"])
    cases: Numbered = [(0, {}), (1, {"run.duration_s": 0.0009})]
    row, failed = run_cases_with_worst("plate_energy_db", setup, "run", cases)
    assert row["worst_plate_energy_db"] == np.inf
    assert max(row["worst_latencies_us"]) <= 20
    assert failed["worst_cases"] is None


@pytest.mark.usefixtures("few_cases")
def test_python_has_the_worst_values_and_latencies():
    pytest.importorskip("xarray")
    over = {"controller.jitter_us": [0, 3]}
    scene = hertzloop.load("aluminium-3mm", {"run.duration_s": 0.0016})
    found = hertzloop.sweep(scene, SweepRequest(over, workers=1, worst="plate_energy_db"))
    assert found.worst_plate_energy_db[1] > found.plate_energy_db[1]
    assert found.worst_latencies_us.dims == ("case", "sample")
    assert np.isnan(found.worst_latencies_us[0]).all()
    assert found.worst_latencies_us[1].max() == 3


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            ["--worst", "loudness", "--over", "controller.jitter_us=3"],
            "--worst = 'loudness': unknown metric. Use one of plate_energy",
        ),
        (["--over", "controller.kappa=0,1"], "controller.jitter_us = 0: --worst searches"),
        (["--over", "controller.jitter_us=0"], "controller.jitter_us = 0: --worst searches"),
        (["--set", "controller.law=off", "--over", "controller.jitter_us=3"], "law = 'off'"),
        (["--over", "controller.jitter_us=3", "--over", "controller.clock_ppm=0,20"], "= 20: --wo"),
        (
            ["--over", "controller.jitter_us=3", "--set", "controller.latency_trace=[1.0, 2.0]"],
            "controller.latency_trace = (1.0, 2.0): --worst searches all latencies",
        ),
    ],
)
def test_refused(tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    done = invoke([*WORDS, *words])
    assert done.exit_code == 2
    assert says in " ".join(done.output.split())
    assert not list(tmp_path.iterdir())
