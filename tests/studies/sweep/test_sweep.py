"""Sweeps: designs, cases and their metrics, same bytes as processes, results, mistakes."""

import math
from pathlib import Path
from typing import Any

import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.results.cases import metrics_of_case
from hertzloop.results.impacts import first_impact
from hertzloop.scene.setup import load
from hertzloop.scene.toml import to_toml
from hertzloop.studies.cases import evaluate
from hertzloop.studies.cases.axis import Axis
from hertzloop.studies.cases.design import Design
from hertzloop.studies.cases.identity import code_version
from hertzloop.studies.cases.workers import WorkersLost
from hertzloop.studies.sweep import sweep as study
from hertzloop.studies.sweep.plan import SweepPlan
from hertzloop.studies.sweep.results_file import read_results, write_results
from tests.commands import as_options, call, refused, succeed
from tests.hertzloop.scenes import json_in
from tests.studies.sweeping import COARSE, ONE_WORKER


@pytest.mark.parametrize("model", ["modal", "infinite"])
def test_the_impulse_of_a_case_is_the_change_of_momentum_in_its_first_contact(model):
    scene = load("aluminium-3mm", ["run.duration_s=0.0016", f"run.plate_model={model}"])
    case, found = metrics_of_case(scene), first_impact(scene, simulate(scene).truth)
    assert found is not None
    it, sphere = found.impact, scene.mechanics.sphere
    change = sphere.mass_kg * (it.impact_speed_m_s + it.rebound_speed_m_s)
    weight = sphere.mass_kg * GRAVITY_M_S2 * it.duration_s
    assert case.impulse_n_s == pytest.approx(change + weight, rel=2e-5)  # read from the gap
    assert case.impulse_n_s == pytest.approx(simulate(scene).balance.contact_impulse_n_s, rel=1e-12)


def test_a_case_takes_the_infinite_plate_where_that_meets_the_accuracy():
    settings = ["run.duration_s=0.0016", "controller.kappa=0.5", "run.accuracy=0.003"]
    scene = load("aluminium-3mm", settings)
    mine, modal = (metrics_of_case(scene.vary({"run.plate_model": m})) for m in ("auto", "modal"))
    assert (mine.plate_model, modal.plate_model) == ("infinite", "modal")
    assert mine.digest != modal.digest
    assert mine.rebound_m_s == pytest.approx(modal.rebound_m_s, rel=1e-3)
    assert mine.plate_energy_j == pytest.approx(modal.plate_energy_j, rel=2e-3)
    # Not to the end of the run, by when reflections are back; nor at a tighter accuracy.
    assert metrics_of_case(scene, "run").plate_model == "modal"
    assert metrics_of_case(scene.vary({"run.accuracy": 1e-5})).plate_model == "modal"


def test_the_span_of_a_run_takes_all_contacts():
    scene = load("aluminium-20mm", ["run.duration_s=0.006", "controller.law=off", *COARSE])
    assert metrics_of_case(scene, "impact").contacts == 1
    assert metrics_of_case(scene, "run").contacts > 1


def test_a_case_that_cannot_be_has_a_row_that_says_so():
    rows = evaluate.run_chunk(
        to_toml(load("aluminium-3mm", COARSE).scene),
        "impact",
        [(0, {"controller.latency_us": 0.5}), (1, {"controller.latency_us": 1})],
    )
    assert "must be a whole number of steps" in rows[0]["status"]
    assert rows[0]["plate_energy_db"] is None
    assert rows[1]["status"] == ""


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_results_come_back_with_scene_and_versions(tmp_path, suffix):
    scene = load("aluminium-3mm", COARSE)
    axes = (Axis("sensors.bits", (6, "ideal")), Axis("plate.contact_point_m", ([0.2, 0.2],)))
    out = tmp_path / f"r{suffix}"
    plan = SweepPlan(scene, Design(axes), ONE_WORKER)
    found = study.sweep(plan, out)
    rows, header = read_results(out)
    assert [row["sensors.bits"] for row in rows] == [6, "ideal"]
    assert [row["plate.contact_point_m"] for row in rows] == [[0.2, 0.2]] * 2
    assert [row["digest"] for row in rows] == [row["digest"] for row in found.rows]
    assert header["scene_toml"] == to_toml(scene.scene)
    assert header["versions"] == code_version()
    assert not study.journal_of(out).exists()
    # Results of an earlier version lack a metric.
    older = [{k: v for k, v in row.items() if k != "radiated_db"} for row in found.rows]
    write_results(out, older, plan.identity)
    assert [row["radiated_db"] for row in read_results(out)[0]] == [None, None]


def test_a_repeated_sweep_says_that_its_results_are_there(tmp_path, monkeypatch):
    """A signal may come when a sweep is done; another sweep does not replace them."""
    monkeypatch.chdir(tmp_path)
    words = ["sweep", "aluminium-3mm", "--set", COARSE[0], "--over", "sensors.bits=8,9"]
    words += ["--workers", "1", "--out", "r.csv"]
    first = call(*words)
    assert first.exit_code == 0, first.output
    before = (tmp_path / "r.csv").read_bytes()
    (tmp_path / "r.csv.partial").touch()  # the signal came before it was removed
    again = call(*words)
    assert again.exit_code == 0, again.output
    assert "r.csv has the results of this sweep" in again.stderr
    assert again.stdout.splitlines()[:9] == first.stdout.splitlines()[:9]
    refused("r.csv exists", *words, "--set", "controller.latency_us=1")
    assert (tmp_path / "r.csv").read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["r.csv", "r.csv.json"]


def test_an_analysis_that_fails_costs_no_results(tmp_path, monkeypatch):
    """The growth of the linear loop is computed when all cases are done."""

    def broken(setup: Any) -> Any:
        raise FloatingPointError("divide by zero")

    monkeypatch.setattr("hertzloop.studies.sweep.growth.growth_of", broken)
    scene = load("aluminium-3mm", [*COARSE, "controller.law=velocity_feedback"])
    axes = (Axis("controller.kappa", (0.01, 0.02)),)
    found = study.sweep(SweepPlan(scene, Design(axes), ONE_WORKER), tmp_path / "r.csv")
    assert all(math.isnan(row["growth_per_s"]) for row in found.rows)
    assert len(read_results(tmp_path / "r.csv")[0]) == 2


@pytest.mark.parametrize(
    ("name", "header"),
    [
        ("a.parquet", ""),
        ("b.csv", "nothing"),
        ("b.csv", "[1]"),
        ("b.csv", '{"design": {"axes": []}}'),
    ],
)
def test_other_files_are_no_results(tmp_path, name, header):
    (tmp_path / name).write_text("a,b\n1,2\n")
    (tmp_path / f"{name}.json").write_text(header)
    with pytest.raises(ValueError, match="no results of a sweep"):
        read_results(tmp_path / name)


def test_an_unstable_case_was_run_but_has_no_metrics(tmp_path):
    report = tmp_path / "r.json"
    late = ["controller.law=velocity_feedback", "controller.latency_us=20", "run.duration_s=0.01"]
    words = ["--workers", "1", "--span", "run", "--json", report, "-o", tmp_path / "r.csv"]
    words += ["--over", "controller.kappa=0.2,1.2", *as_options([*COARSE, *late])]
    said = succeed("sweep", "aluminium-20mm", *words)
    assert "1 of 2 cases are unstable and have no metrics" in said
    told = json_in(report)
    assert (told["ran"], told["failed"], told["unstable"]) == (2, 0, 1)


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["thesis-aluminium"], 2, "run.scheme = 'thesis2008'"),
        (["--out", "folder.csv", "--overwrite"], 2, "folder.csv: is a folder"),
        (["--set", "run.duration_s=0.0009"], 1, "2 of 2 cases failed"),
        (["--over", "controller.latency_us"], 2, "controller.latency_us=0:100:1"),
    ],
)
def test_mistakes_in_a_sweep_end_it(tmp_path, monkeypatch, words, code, says):
    monkeypatch.chdir(tmp_path)
    Path("folder.csv").mkdir()
    usual = ["sweep", "--workers", "1", "--over", "controller.kappa=0,1", "-o", "r.csv"]
    refused(says, *usual, *words, code=code)


def test_a_worker_that_is_lost_over_the_other_span_does_not_end_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def lost(count):
        raise WorkersLost("a worker process died")

    monkeypatch.setattr("hertzloop.cli.sweep.local_pool", lost)
    over = ["--over", "run.touch_phase=0.25,0.75", "--set", COARSE[0], "--json", "told.json"]
    said = succeed("sweep", "aluminium-3mm", *over, "--workers", "1")
    assert "has no value over the other span: a worker process died" in said
    assert json_in("told.json")["failed"] == 0
