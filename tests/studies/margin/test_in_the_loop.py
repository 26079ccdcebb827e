"""Run, sweep and tune say when the linear loop is unstable and the run too short to show it."""

from pathlib import Path

import pytest

from hertzloop.plant.plant import modes_of
from hertzloop.scene.setup import load
from hertzloop.studies.margin.flight import margin_of
from hertzloop.studies.margin.growth import growth_of
from hertzloop.studies.sweep.results_file import read_results
from tests.commands import as_options, succeed
from tests.hertzloop.scenes import json_in

ROUGH = ["run.accuracy=0.01", "run.duration_s=0.0016"]
SHORT = [*ROUGH, "controller.latency_us=2"]
FEEDBACK = ["controller.law=velocity_feedback", "sensors.quantity=v_p"]
VELOCITY = [*SHORT, *FEEDBACK]


def report_of(tmp_path: Path, settings: list[str]) -> tuple[dict, str]:
    out, words = tmp_path / "report.json", [*as_options(settings), "--transport", "compiled"]
    said = succeed("run", "aluminium-3mm", *words, "-o", tmp_path / "x.mcap", "--json", out)
    return json_in(out), said


def test_a_run_warns_of_an_instability_that_it_cannot_show(tmp_path):
    settings = [*VELOCITY, "controller.kappa=0.4"]
    report, said = report_of(tmp_path, settings)
    found = margin_of(load("aluminium-3mm", settings))
    assert found.stable is False
    loop = report["linear_loop"]
    assert loop["unstable_poles"] == found.unstable_poles
    assert loop["per_s"] == found.growth_per_s
    assert loop["e_folds"] == pytest.approx(found.growth_per_s * 0.0016)
    assert not report["stability"]["unstable"]  # the run itself does not show it
    assert f"Linear loop unstable: grows {found.growth_per_s:.4g}/s" in said
    assert "e-folds over this run" in said
    assert "the run is too short to show it" in said


@pytest.mark.parametrize("law", [["controller.kappa=0.01", *VELOCITY], SHORT])
def test_a_run_is_silent_on_a_stable_loop_and_on_a_law_without_one(tmp_path, law):
    report, said = report_of(tmp_path, law)
    assert "Linear loop" not in said
    growth = growth_of(load("aluminium-3mm", law))
    assert (growth is None) == (law is SHORT)
    assert report["linear_loop"] == (
        None
        if growth is None
        else {"unstable_poles": 0, "per_s": 0.0, "frequency_hz": None, "e_folds": 0.0}
    )


def test_a_law_without_a_gain_has_no_limit_of_it():
    setup = load("aluminium-3mm", [*VELOCITY, "controller.kappa=0"])
    found = margin_of(setup)
    assert (found.stable, found.gain_margin, found.latency_limit_us) == (True, None, None)
    assert found.modes == len(modes_of(setup.with_plate_model("modal").plant).omega)


UNDAMPED = [*VELOCITY, "controller.kappa=0.05", "plate.loss_factor=0"]


def test_an_undamped_plate_is_the_limit_of_little_damping(tmp_path):
    """Its poles are on the stability limit, where the loop gain has no value."""
    found, little = (
        margin_of(load("aluminium-3mm", [*UNDAMPED, f"plate.loss_factor={eta}"]))
        for eta in ("0", "1e-9")
    )
    assert found.unstable_poles == little.unstable_poles > 0
    assert found.growth_per_s == pytest.approx(little.growth_per_s, rel=1e-4)
    assert found.gain_margin == 0.0
    succeed("margin", "aluminium-3mm", *as_options(UNDAMPED))
    report, said = report_of(tmp_path, UNDAMPED)
    assert report["linear_loop"]["per_s"] == found.growth_per_s
    assert "Linear loop unstable" in said


def test_no_analysis_costs_the_results_of_a_run(tmp_path, monkeypatch):
    def fails(setup: object) -> None:
        raise RuntimeError("no such number")

    monkeypatch.setattr("hertzloop.studies.margin.growth.growth_of", fails)
    report, said = report_of(tmp_path, VELOCITY)
    assert report["linear_loop"] is None
    assert "Linear loop: not analysed (RuntimeError('no such number'))" in said


def test_a_sweep_has_the_growth_of_every_case(tmp_path):
    out, told = tmp_path / "r.parquet", tmp_path / "t.json"
    settings = [*ROUGH, *FEEDBACK, "controller.kappa=0.4"]
    over = ["--over", "controller.latency_us=2,3", "--over", "run.touch_phase=0,0.6"]
    words = [*as_options(settings), *over, "--workers", "1", "-o", out, "--json", told]
    said = succeed("sweep", "aluminium-3mm", *words)
    for row in read_results(out)[0]:
        latency = f"controller.latency_us={row['controller.latency_us']}"
        case = load("aluminium-3mm", [*settings, latency])
        assert row["growth_per_s"] == margin_of(case).growth_per_s > 0.0
    assert json_in(told)["unstable_loops"] == 4
    assert "Linear loop unstable in 4 of 4 cases" in said


@pytest.mark.full
def test_the_command_tune_refuses_an_unstable_loop(tmp_path):
    def front(*more: str) -> tuple[list[dict], str]:
        out = tmp_path / f"t{len(more)}.json"
        words = ["--minimise", "plate_energy_db", "--vary", "controller.kappa=0:0.6"]
        words += ["--generations", "2", "--population", "6", "--json", out, *more]
        said = succeed("tune", "aluminium-3mm", *as_options(VELOCITY), *words)
        return json_in(out)["front"], said

    [free], said = front()
    assert free["unstable_loop"]["unstable_poles"] > 0
    assert "Linear loop unstable in 1 of 1 settings. --require-stable refuses these." in said
    [kept], said = front("--require-stable")
    assert kept["unstable_loop"] is None
    assert "Linear loop" not in said
