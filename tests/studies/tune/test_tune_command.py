"""The command `tune`: mistakes end with a sentence, results have the scene's name."""

from pathlib import Path

import pytest

from tests.commands import refused, succeed
from tests.hertzloop.scenes import json_in

QUICK = ["--set", "run.accuracy=0.05", "--set", "run.duration_s=0.0016", "--generations", "1",
         "--population", "4", "--minimise", "plate_energy_db"]  # fmt: skip

KAPPA = ["--vary", "controller.kappa=0:1"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["thesis-aluminium"], "run.scheme = 'thesis2008'"),
        (["--over", "controller.kappa=0.1,0.5"], "--over controller.kappa: the search varies this"),
        (["--at-most", "rebound_percent=nan"], "invalid limit"),
        (["--law", "slope_threshold", "--law", "off"], "controller.law = 'off' has no parameters"),
        (["--set", "controller.law=off"], "Use one of acceleration_feedback, "),
        (["--minimise", "nonsense"], "unknown metric"),
        (KAPPA + KAPPA, "--vary controller.kappa is given twice"),
        ([*KAPPA, "--over", "controller.kappa=0.8"], "is given to both --vary and --over"),
        (
            ["--law", "fade_out", "--law", "predicted", "--over", "controller.lead_us=0,1"],
            "controller.lead_us = 1: has no effect on controller.law = 'predicted'",
        ),
    ],
)
def test_mistakes_are_the_users(words, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(says, "tune", *words)
    assert not list(tmp_path.iterdir())


def test_settings_that_could_not_be_run_are_counted_apart(tmp_path):
    """A run of 0.9 ms ends before the sphere has fallen; the search goes on without it."""
    report = tmp_path / "r.json"
    words = ["tune", "aluminium-3mm", *QUICK, "--json", report]
    succeed(*words)
    told = json_in(report)
    # 4 and the published setting; then this and the best one at 5 touch phases.
    assert (told["cases"], told["failed"]) == (15, 0)
    said = refused("cases failed", *words, "--vary", "run.duration_s=0.0009,0.0016", code=1)
    told = json_in(report)
    assert 1 <= told["failed"] <= 3
    assert told["front"]
    assert f"{told['failed']} of 15 cases failed" in said


OWN_LAW = """
from pydantic import Field

from hertzloop.law import Keys, StepsUs


class Parameters(Keys):
    often: int = Field(3, ge=1, le=9)
    wait_us: StepsUs = Field(0.0, ge=0.0, le=40.0)


def command(p, s, samples, i):
    return 0.0
"""


@pytest.mark.full
@pytest.mark.parametrize(
    ("law", "key"), [("fade_out", "fade_us"), ("precomputed", "delay_us"), ("mine.py", "wait_us")]
)
def test_a_law_that_the_scene_has_not_is_tuned_in_whole_steps(law, key, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(OWN_LAW)
    # The coarser of the scenes decides: what it can have, the other can.
    steps = ["--over", "run.step_ns=500,1000"]
    succeed("tune", "aluminium-3mm", "--law", law, *QUICK, *steps, "--json", "r.json")
    told = json_in("r.json")
    assert (told["cases"], told["failed"]) == (30, 0)
    best = told["front"][0]["values"]
    assert best[f"controller.{key}"] == round(best[f"controller.{key}"])
    assert isinstance(best.get("controller.often", 1), int)


@pytest.mark.full
def test_nothing_is_said_to_beat_a_published_setting_that_a_scene_refuses(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # The published law needs the penetration, which only a sensor at the contact has.
    senses = ["--set", "controller.law=acceleration_feedback", "--out-dir", "found"]
    senses += ["--set", "sensors.point_m=[0.3,0.25]"]
    # The published setting counts as a failed case.
    refused("", "tune", "aluminium-3mm", *senses, *QUICK, "--json", "r.json", code=1)
    told = json_in("r.json")
    assert set(told["published"]["metrics"].values()) == {None}
    assert told["verdict"][0].startswith("the published setting has no metrics")


def test_all_laws_can_be_tuned(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    succeed("tune", "aluminium-3mm", "--law", "all", *QUICK, "--json", "r.json")
    assert json_in("r.json")["failed"] == 0
