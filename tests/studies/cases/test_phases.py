"""Mean and range over the touch phase: in sweeps, in tuning, of critical latencies."""

import csv
import re

import numpy as np
import pytest

from hertzloop.results.cases import metrics_of_case
from hertzloop.results.touch_phases import TOUCH_PHASE_KEY, phases, spread_of
from hertzloop.scene.setup import load
from hertzloop.studies.cases.axis import Axis
from hertzloop.studies.tune.plan import TunePlan
from hertzloop.studies.tune.request import TuneRequest
from hertzloop.studies.tune.score import with_spreads
from hertzloop.studies.tune.search import search_law
from tests.commands import as_options, invoke, refused, succeed
from tests.hertzloop.scenes import json_in

CHEAP = ("run.accuracy=0.1", "run.duration_s=0.0013")
EARLY = (*CHEAP, "controller.v_thr_m_s=-0.6")


def by_hand(**changes: object) -> list[float]:
    scene = load("aluminium-3mm", EARLY)
    values = {key.replace("__", "."): value for key, value in changes.items()}
    cases = (scene.vary(values | {TOUCH_PHASE_KEY: phase}) for phase in phases())
    return [metrics_of_case(case).plate_energy_db for case in cases]


def test_phases_are_spread_evenly_about_the_middle():
    assert phases() == (0.1, 0.3, 0.5, 0.7, 0.9)
    assert phases(2) == (0.25, 0.75)
    found = spread_of([1.0, 3.0, 2.0])
    assert (found.mean, found.least, found.most) == (2.0, 1.0, 3.0)
    assert np.isnan(spread_of([1.0, np.nan]).mean)


def test_a_sweep_over_phases(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["sweep", "aluminium-3mm", *as_options(EARLY), "--workers", "1"]
    words += ["--over", "controller.latency_us=0,3", "--phases", "5"]
    told = succeed(*words, "-o", "a.csv", "--json", "a.json")
    assert "Over touch phases: mean (least to most)" in told
    assert len(list(csv.DictReader((tmp_path / "a.csv").open()))) == 10
    for group in json_in("a.json")["over_phases"]:
        values = by_hand(controller__latency_us=group["controller.latency_us"])
        found = group["plate_energy_db"]
        assert found["mean"] == pytest.approx(np.mean(values))
        assert (found["least"], found["most"]) == pytest.approx((min(values), max(values)))
    wrong = ["--design", "sobol", "--phases", "3", "--over", "controller.kappa=0:1"]
    refused("--phases 3 needs --design grid", "sweep", *wrong)


def test_a_sweep_shows_the_height_of_a_rebound_that_is_zero_without_control(tmp_path, monkeypatch):
    """Where a share of it has no value."""
    monkeypatch.chdir(tmp_path)
    words = ["sweep", "aluminium-20mm", *as_options(["run.duration_s=0.004"]), "--workers", "1"]
    done = invoke([*words, "--over", "controller.latency_us=0,30", "--phases", "3", "-o", "a.csv"])
    assert done.exit_code == 0, done.output
    assert "nan" not in done.output
    assert "rebound_height_mm" in done.output
    [late] = [line for line in done.output.splitlines() if re.match(r"│ +30 │ .* to ", line)]
    assert "1.5" in late.split("│")[3]


def test_tuning_searches_by_the_mean_and_tells_the_range(pool):
    scene = load("aluminium-3mm", EARLY)
    axes = (Axis("controller.v_thr_m_s", (-0.9, -0.6, -0.25)),)
    request = TuneRequest(minimise=("plate_energy_db",), generations=3, population=4, phases=5)
    plan = TunePlan([scene], [scene], {"slope_threshold": axes}, request)
    found = search_law(pool, plan, "slope_threshold")
    (best,) = with_spreads(pool, plan, found[:1])
    values = by_hand(controller__v_thr_m_s=best.values["controller.v_thr_m_s"])
    assert best.metrics["plate_energy_db"] == pytest.approx(np.mean(values))
    spread = best.spreads["plate_energy_db"]
    assert (spread.least, spread.most) == pytest.approx((min(values), max(values)))
    assert spread.most > spread.least + 0.1
