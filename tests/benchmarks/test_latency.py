"""The latency study: maps, critical values read off, pictures."""

import json
import math

import pytest
from typer.testing import CliRunner

from benchmarks import latency as study
from benchmarks.latency_pictures import draw_maps
from benchmarks.program import app_of
from hertzloop.scene.setup import load
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.pages.words import METRICS


@pytest.fixture(scope="module")
def pool():
    with local_pool(1) as pool:
        yield pool


def named(*settings: str) -> study.Named:
    cheap = ("run.accuracy=0.1", "run.duration_s=0.0013")
    return study.Named("cheap", "aluminium-3mm", (*cheap, *settings), "impact")


@pytest.mark.full
def test_a_map_has_every_pair_and_a_picture(pool, tmp_path):
    maps = study.maps(pool, named(), 4)
    for key, values in study.map_axes(named().scene(), 4).items():
        pairs = {(row["controller.latency_us"], row[key]) for row in maps[key]}
        assert len(pairs) == len(maps[key]) == 5 * len(values)
    draw_maps(tmp_path / "m.png", "cheap", maps, METRICS)
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")


def test_the_critical_latency_is_where_the_plate_energy_crosses(pool):
    early = named("controller.v_thr_m_s=-0.6")
    found = study.critical(pool, early, "slope_threshold", 5)
    scene = early.scene()
    at, after = (
        study.evaluate(pool, scene, "impact", [{"controller.latency_us": int(latency)}])[0]
        for latency in (found.critical_latency_us, found.critical_latency_us + 1)
    )
    assert at["plate_energy_db"] < 0.0 <= after["plate_energy_db"]


@pytest.mark.parametrize(
    ("good", "bits"),
    [([True] * 16, 3.0), ([False] * 16, math.nan), ([False, True, False, *[True] * 13], 6.0)],
)
def test_fewest_bits_from_which_on_all_are_good(good, bits):
    assert study._fewest_bits(good) == pytest.approx(bits, nan_ok=True)


def test_an_unstable_law_survives_nothing(pool):
    unstable = named("controller.kappa=3.0")
    found = study.critical(pool, unstable, "slope_threshold", 2)
    assert found.ideal_db > 0.0
    assert math.isnan(found.critical_latency_us)


def test_the_best_law_and_what_it_buys():
    def row(law: str, us: float) -> study.Critical:
        return study.Critical(
            "s", law, 0.8, -1.0, 100.0, us, 50.0, 3.0, 3.0, -1.0, -1.0, -1.0, us, us
        )

    found = [row("slope_threshold", math.nan), row("predicted", math.inf), row("fade_out", 20.0)]
    assert list(study.best_laws(found)) == [("s", "predicted", 50.0, 50.0)]
    found[0] = row("slope_threshold", 12.0)
    assert list(study.best_laws(found)) == [("s", "predicted", 50.0, 38.0)]


@pytest.mark.full
def test_a_scene_and_gains_of_the_user(tmp_path, monkeypatch):
    """Of that scene alone, at 80 columns without a cell that is cut."""
    monkeypatch.setattr(study, "LAWS", ("slope_threshold", "acceleration_feedback"))
    monkeypatch.setattr(study, "local_pool", lambda: local_pool(1))
    settings = [
        "run.accuracy=0.1",
        "run.duration_s=0.0013",
        "plate.thickness_m=0.004",
        "controller.kappa=0.3",
    ]
    words = [word for setting in settings for word in ("--set", setting)]
    command = ["offcentre-6mm", *words, "--quick", "-o", str(tmp_path)]
    command += ["--json", str(tmp_path / "a.json")]
    runner, app = CliRunner(), app_of(study.main)
    done = runner.invoke(app, command, env={"COLUMNS": "80"})
    assert done.exit_code == 0, done.output
    assert "offcentre-6mm: latency and bits that each law tolerates" in done.output
    assert "…" not in done.output
    ruled = [line for line in done.output.splitlines() if line[:1] in "│┃┏└"]
    assert max(map(len, ruled)) <= 80
    found = json.loads((tmp_path / "a.json").read_text())["critical"]
    assert [(row["scene"], row["law"], row["kappa"]) for row in found] == [
        ("offcentre-6mm", "slope_threshold", 0.3),
        ("offcentre-6mm", "acceleration_feedback", 0.3),
    ]
    for row in found:  # whole numbers, as in the file
        assert f"{row['ideal_db']:.2f}" in done.output.replace("\n", " ")
    assert len(list(tmp_path.glob("latency-offcentre-6mm-*.csv"))) == 4
    refused = runner.invoke(app, [command[0], "--set", "plate.thickness=1", *command[-4:]])
    assert refused.exit_code == 2
    assert "plate.thickness" in refused.output


def test_a_law_without_kappa_has_maps_of_what_it_has():
    scene = load("aluminium-3mm", ["controller.law=off"])
    assert list(study.map_axes(scene, 4)) == ["sensors.bits", "sensors.every_steps"]
