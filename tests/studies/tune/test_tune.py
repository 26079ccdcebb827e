"""Tuning: optima that a grid confirms, fronts, limits, sets of scenes."""

from pathlib import Path

import numpy as np
import pytest

from hertzloop.controller.loading.registry import find, shipped
from hertzloop.results.cases import metrics_of_case
from hertzloop.scene.setup import Setup, load
from hertzloop.studies.cases.axis import Axis
from hertzloop.studies.cases.evaluate import Pool
from hertzloop.studies.tune.plan import TunePlan, ranges_of
from hertzloop.studies.tune.request import TuneRequest
from hertzloop.studies.tune.result import Candidate, TuneResult, best_first, better_than
from hertzloop.studies.tune.score import published_setting
from hertzloop.studies.tune.search import front as pareto_front
from hertzloop.studies.tune.search import search_law
from tests.commands import as_options, succeed

KAPPA = (Axis("controller.kappa", (), -0.5, 1.5),)
BOTH = ("plate_energy_db", "rebound_percent")
CHEAP = ["run.accuracy=0.1", "run.duration_s=0.0013"]


@pytest.fixture(scope="module")
def scene():
    return load("aluminium-3mm", CHEAP)


def energy(scene: Setup, kappa: float) -> float:
    values = {"controller.law": "force_feedback", "controller.kappa": kappa}
    return metrics_of_case(scene.vary(values)).plate_energy_db


def best(pool: Pool, scenes: list[Setup], at_most: dict[str, float]) -> Candidate:
    request = TuneRequest(
        minimise=("plate_energy_db",), generations=12, population=10, at_most=at_most
    )
    plan = TunePlan(scenes, scenes, {"force_feedback": KAPPA}, request)
    return search_law(pool, plan, "force_feedback")[0]


def test_the_best_gain_is_the_one_that_a_fine_grid_finds(pool, scene):
    kappas = np.linspace(-0.5, 1.5, 101)
    grid = [energy(scene, float(kappa)) for kappa in kappas]
    found = best(pool, [scene], {})
    assert found.metrics["plate_energy_db"] <= min(grid) + 0.02
    assert abs(found.values["controller.kappa"] - kappas[int(np.argmin(grid))]) < 0.03


def test_a_limit_is_kept(pool, scene):
    free, limited = best(pool, [scene], {}), best(pool, [scene], {"rebound_percent": 130.0})
    rebound = metrics_of_case(scene.vary(limited.values)).rebound_percent
    assert rebound <= 130.0
    assert rebound > 120.0  # and used
    assert limited.metrics["plate_energy_db"] > free.metrics["plate_energy_db"]


def test_over_a_set_of_scenes_the_worst_counts(pool, scene):
    other = scene.vary({"controller.latency_us": 6})
    found = best(pool, [scene, other], {})
    alone = [metrics_of_case(s.vary(found.values)).plate_energy_db for s in (scene, other)]
    assert found.metrics["plate_energy_db"] == pytest.approx(max(alone), abs=1e-12)
    assert alone[0] != alone[1]


def test_a_front_holds_nothing_that_another_beats(pool, scene):
    request = TuneRequest(generations=6, population=16, seed=2)
    plan = TunePlan([scene], [scene], {"predicted": ranges_of("predicted", 1.0)}, request)
    found = search_law(pool, plan, "predicted")
    front = pareto_front(found + found, BOTH)
    values = np.array([[f.metrics[name] for name in BOTH] for f in front])
    assert len(values) > 3
    for row in values:
        beats = np.all(values <= row, axis=1) & np.any(values < row, axis=1)
        assert not beats.any()
    assert np.all(np.diff(values[:, 0]) > 0.0)
    assert all(isinstance(f.values["controller.window_samples"], int) for f in front)
    # The published setting is beaten without raising the rebound.
    reference = published_setting(pool, plan)
    winner = better_than(reference, front, *BOTH)
    assert winner.metrics["rebound_percent"] <= reference.metrics["rebound_percent"]


@pytest.mark.parametrize("law", shipped())
def test_a_search_may_come_back_with_what_a_scene_starts_from(law):
    for axis in ranges_of(law, 1.0):
        default = find(law).keys.model_fields[axis.key.removeprefix("controller.")].default
        assert axis.low <= default <= axis.high, axis


def test_without_a_better_setting_none_is_named():
    good = Candidate({}, {"a": 0.0, "b": 0.0})
    assert better_than(good, [Candidate({}, {"a": -1.0, "b": 1.0})], "a", "b") is None
    assert better_than(good, [Candidate({}, {"a": 0.0, "b": -1.0})], "a", "b") is None
    result = TuneResult(["a", "b"], "impact", {}, [good], good, [], 1, 1)
    assert result.verdict == "none beats the published setting in a without raising b"


def test_unstable_settings_are_not_offered(pool):
    scene = load("aluminium-3mm", [*CHEAP, "controller.latency_us=5"])
    axes = (Axis("controller.kappa", (), 25.0, 30.0),)
    request = TuneRequest(generations=2, population=6)
    plan = TunePlan([scene], [scene], {"velocity_feedback": axes}, request)
    assert search_law(pool, plan, "velocity_feedback") == []


def test_the_command_writes_front_and_picture(tmp_path):
    scene = str(Path(__file__).parents[3] / "hertzloop" / "scene" / "aluminium-3mm.toml")
    words = ["--law", "force_feedback", "--generations", "2", "--population", "6"]
    assert "published" in succeed("tune", scene, *words, *as_options(CHEAP), "-o", tmp_path)
    files = {f"tune-aluminium-3mm.{kind}" for kind in ("csv", "png")}
    assert {f.name for f in tmp_path.iterdir()} == files | {"tuned-aluminium-3mm.toml"}
    assert (tmp_path / "tune-aluminium-3mm.png").read_bytes().startswith(b"\x89PNG")
    lines = (tmp_path / "tune-aluminium-3mm.csv").read_text().splitlines()
    metrics = {"plate_energy_db", "rebound_percent", "plate_energy_db_mean", "controller.kappa"}
    assert metrics <= set(lines[0].split(","))
    assert len(lines) > 2


def test_the_best_setting_is_the_first_of_the_front():
    published = Candidate({}, {"a": 0.0, "b": 0.0})
    loud, best, mild = (Candidate({}, {"a": a, "b": b}) for a, b in ((-9, 5), (-3, 0), (-1, -2)))
    front = best_first([loud, best, mild], published)
    assert front == [best, mild, loud]
    result = TuneResult(["a", "b"], "impact", {}, front, published, [], 1, 1)
    assert result.best is result.winner is front[0]
