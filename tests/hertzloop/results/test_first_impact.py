"""The first impact is the same span, with the same metrics, wherever a metric of it is shown."""

import math
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hertzloop
from hertzloop.controller.loading.registry import shipped
from hertzloop.loop.simulate import simulate
from hertzloop.plant.time_series import F_A
from hertzloop.recordings.reader import read
from hertzloop.results.cases import CaseMetrics, metrics_of_case
from hertzloop.results.impacts import impacts_of
from hertzloop.results.span_metrics import SPAN_FACTS, decibels
from hertzloop.scene.setup import Setup, load
from hertzloop.scene.toml import to_toml
from hertzloop.studies.report.page import page_of
from hertzloop.views.metrics_table import cells_of, further_rows, shown_rows
from tests.commands import succeed
from tests.hertzloop.own_laws import ECHO
from tests.hertzloop.scenes import aluminium_3mm, json_in
from tests.tiers import default

# Three contacts, 1.3 ms apart at first: a law that sees one coming pushes before it.
SHORT = ["run.accuracy=0.05", "run.duration_s=0.004", "controller.latency_us=20"]
PROMISE = """
def trigger_level(p, s):
    return 0.0 if s.mode == 0 else NO_TRIGGER
"""
# A push of so many samples, so many samples after the sphere has left.
LATE = """
from hertzloop.law import NO_TRIGGER

class State:
    mode: int = 0
    since: int = 0

def command(p, s, samples, i):
    if samples[i] <= 0.0:
        s.mode = 1
        s.since = 0
    elif s.mode == 1:
        s.since += 1
        if s.since > {last}:
            s.mode = 0
    return {force} if s.mode == 1 and {first} <= s.since <= {last} else 0.0
"""
# Pushes where a contact comes, and sees the next one.
AHEAD = """
class State:
    mode: int = 0

def command(p, s, samples, i):
    return 2.0 if i > 0 and samples[i] < 5e-5 and samples[i] < samples[i - 1] else 0.0

def trigger_level(p, s):
    return 5e-5
"""
OWN = {
    "echo.py": ECHO.format(line="pass"),
    "late.py": LATE.format(force=-20.0, first=5, last=30),
    "late_promise.py": LATE.format(force=-20.0, first=5, last=30) + PROMISE,
    # Longer than the silence after which an impact may be over.
    "again.py": LATE.format(force=-5.0, first=180, last=230),
    "again_promise.py": LATE.format(force=-5.0, first=180, last=230) + PROMISE,
    # Pushes the plate on until it meets the sphere again.
    "long.py": LATE.format(force=60.0, first=0, last=4000),
}
LAWS = default([*shipped(), *OWN], ["off", "velocity_feedback", "slope_threshold", *OWN])
FORCES = {
    "constant": ["controller.force_n=20", "controller.duration_us=200", "controller.delay_us=1400"],
    "profile": ["controller.profile_n=[10.0, 20.0, 30.0]", "controller.lead_us=1"],
    "precomputed": ["controller.precomputed=F_a7", "controller.delay_us=30"],
    "linear": ["controller.numerator=[-100.0, 20.0]", "controller.denominator=[1.0, -0.5]"],
}


@dataclass(frozen=True)
class Reports:
    """What everything says of one law: `run --json`, `inspect --json`, a sweep's case, and Python
    from memory and from the recording."""

    scene: Setup
    run: dict[str, Any]
    inspect: dict[str, Any]
    case: CaseMetrics
    python: "list[hertzloop.Run]"


def scene_of(folder: Path, law: str) -> Setup:
    settings = [*SHORT, *FORCES.get(law, [])]
    if law.endswith("feedback"):
        settings.append("controller.kappa=0.3")
    path = folder / law if law in OWN else law
    return load("aluminium-20mm", [*settings, f"controller.law={path}"])


def reports(folder: Path, scene: Setup) -> Reports:
    toml, recording = folder / "scene.toml", folder / "run.mcap"
    toml.write_text(to_toml(scene.scene), encoding="utf-8")
    succeed("run", toml, "--transport", "compiled", "--out", recording, "--json", folder / "r.json",
            "--overwrite")  # fmt: skip
    succeed("inspect", recording, "--json", folder / "i.json")
    run, inspect = (json_in(folder / name) for name in ("r.json", "i.json"))
    python = [hertzloop.simulate(scene.scene), hertzloop.read(recording)]
    return Reports(scene, run, inspect, metrics_of_case(scene), python)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("laws")
    for name, text in OWN.items():
        (found / name).write_text(text, encoding="utf-8")
    return found


@pytest.fixture(scope="module")
def reports_of(folder):
    """Reports of a law, made once."""
    return cache(lambda law: reports(folder, scene_of(folder, law)))


def near(value: Any) -> Any:
    """A number, or numbers by name, but for rounding."""
    return pytest.approx(value, rel=1e-9, nan_ok=True)


def numbers(values: dict[str, float | None]) -> dict[str, float]:
    """JSON has no number that is not finite."""
    return {key: math.nan if value is None else value for key, value in values.items()}


def check(it: Reports, span: str = "first_impact") -> None:
    """Everything says the same of a span."""
    given, free = numbers(it.run[span]), numbers(it.run["uncontrolled"][span])
    assert numbers(it.inspect[span]) == near(given)
    case = asdict(metrics_of_case(it.scene, "run") if span == "whole_run" else it.case)
    expected = {
        "contacts": given["contacts"],
        "plate_energy_j": given["plate_energy_j"],
        "rebound_m_s": given["rebound_speed_m_s"],
        "peak_force_n": given["peak_force_n"],
        "contact_us": 1e6 * given["contact_time_s"],
    }
    change = {
        name: decibels(given[name], free[name], one.db)
        for name, one in SPAN_FACTS.items()
        if one.db
    }
    expected |= {
        "plate_energy_db": change["plate_energy_j"],
        "radiated_db": change["radiated_j"],
        "plate_speed_db": change["plate_speed_max_m_s"],
        "longhorn_db": change["longhorn_j"],
        "pressure_db": change["peak_pressure_pa"],
        "holmes_db": change["holmes_j"],
    }
    if not math.isnan(case["rebound_percent"]):
        heights = given["rebound_height_m"], free["rebound_height_m"]
        expected["rebound_percent"] = 100.0 * heights[0] / heights[1]
    assert {name: case[name] for name in expected} == near(expected)


@pytest.mark.parametrize("law", LAWS)
def test_everything_says_the_same_of_the_first_impact(reports_of, law):
    it = reports_of(law)
    check(it)
    check(it, "whole_run")
    first, noise = numbers(it.run["first_impact"]), it.run["noise"][0]
    energy = near(first["plate_energy_j"])
    assert (noise["transmitted_j"], it.run["impacts"][0]["plate_energy_j"]) == (energy, energy)
    ranges = [{(row["span"], row["metric"]): row["value"] for row in told["rows"]}
              for told in (it.run, it.inspect)]  # fmt: skip
    assert ranges[0] == ranges[1]
    for found in it.python:
        assert found.verdict == it.run["verdict"]
        assert asdict(found.metrics.first_impact) == near(first)
        assert found.impacts[0].plate_energy_j == energy
        assert found.noise[0].plate_speed_max_m_s == near(first["plate_speed_max_m_s"])
        assert found.noise[0].radiated_j == near(first["radiated_j"])


def test_laws_push_when_they_are_meant_to(reports_of):
    """Otherwise the agreement would say little."""
    for law, least, most in (("off", 0, 0), ("late.py", 20, 60), ("again.py", 200, 260)):
        scene = reports_of(law).scene
        first = impacts_of(scene, simulate(scene).truth)[0]
        assert least <= first.over - first.end <= most
    scene = reports_of("long.py").scene
    first, *others = impacts_of(scene, simulate(scene).truth)
    assert first.over == (others[0].start if others else scene.run.steps)


@pytest.mark.parametrize("law", ["late", "again"])
def test_a_promise_changes_no_metric(reports_of, law):
    without, with_ = (reports_of(f"{law}{end}.py").case for end in ("", "_promise"))
    names = {f.name for f in fields(CaseMetrics)} - {"steps", "digest", "energy_residual"}
    for name in names:
        value = getattr(without, name)
        assert getattr(with_, name) == (near(value) if isinstance(value, float) else value), name
    assert with_.steps <= without.steps


@pytest.mark.full
def test_what_comes_before_the_next_contact_does_not_count(tmp_path):
    """Laws whose case ends when the sphere is on its way back, or long before; the report page."""
    ahead = tmp_path / "ahead.py"
    ahead.write_text(AHEAD, encoding="utf-8")
    short = [
        "run.accuracy=0.05",
        "run.duration_s=0.06",
        "run.plate_model=modal",
        "sphere.drop_height_m=0.005",
    ]
    for law in (["force_feedback", "controller.kappa=0.4"], [ahead]):
        it = reports(tmp_path, aluminium_3mm(*short, f"controller.law={law[0]}", *law[1:]))
        assert it.run["whole_run"]["contacts"] > 1
        check(it)
        assert it.case.contacts == 1
        truth = simulate(it.scene).truth
        first, second = impacts_of(it.scene, truth)[:2]
        assert bool(np.any(truth[F_A, first.over : second.start])) == (law == [ahead])
    assert it.case.steps < 5000
    page = page_of(read(tmp_path / "run.mcap"))
    rows = hertzloop.read(tmp_path / "run.mcap").rows
    shown = [*shown_rows(rows), *further_rows(rows)]
    assert all(cell in page for row in shown for cell in cells_of(row))
