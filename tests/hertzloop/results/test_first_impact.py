"""The first impact is the same span, with the same metrics, wherever a metric of it is shown."""

import math
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import hertzloop
from hertzloop.loop.simulate import simulate
from hertzloop.results.cases import CaseMetrics, metrics_of_case
from hertzloop.results.impacts import impacts_of
from hertzloop.results.span_metrics import SPAN_FACTS, decibels
from hertzloop.scene.setup import Setup, load
from hertzloop.scene.toml import to_toml
from tests.commands import succeed
from tests.hertzloop.own_laws import ECHO
from tests.hertzloop.scenes import json_in

# Three contacts, 1.3 ms apart at first: a law that sees one coming pushes before it.
SHORT = ["run.accuracy=0.05", "run.duration_s=0.004", "controller.latency_us=20"]
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
OWN = {
    "echo.py": ECHO.format(line="pass"),
    "late.py": LATE.format(force=-20.0, first=5, last=30),
    # Longer than the silence after which an impact may be over.
    "again.py": LATE.format(force=-5.0, first=180, last=230),
    # Pushes the plate on until it meets the sphere again.
    "long.py": LATE.format(force=60.0, first=0, last=4000),
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
    settings = [*SHORT]
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


@pytest.mark.parametrize("law", ["off", "velocity_feedback", "slope_threshold", *OWN])
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
