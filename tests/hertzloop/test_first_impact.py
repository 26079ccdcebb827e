"""The first impact is the same span, with the same metrics, wherever a metric of it is shown."""

import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hertzloop
from benchmarks.latency import Named, critical
from benchmarks.real_plant import energies_of
from hertzloop.controller.loading.registry import shipped
from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics import truth_kernels as an
from hertzloop.plant.metrics.noise import ImpactNoise
from hertzloop.plant.time_series import F_A
from hertzloop.recordings.reader import read
from hertzloop.results.cases import CaseMetrics, metrics_of_case
from hertzloop.results.impacts import impacts_of_truth
from hertzloop.results.span_metrics import SpanMetrics, changes_db
from hertzloop.scene.setup import Setup, load
from hertzloop.scene.toml import to_toml
from hertzloop.studies.report.page import page_of
from hertzloop.studies.report.results import page_of_results
from hertzloop.studies.requests import TuneRequest
from hertzloop.studies.sweeps.evaluate import evaluate, run_chunk
from hertzloop.studies.tuning import best_of
from hertzloop.views.noise_table import noise_rows
from tests.commands import invoke
from tests.hertzloop.own_laws import ECHO

# Three contacts, 1.3 ms apart at first: a law that sees one coming pushes before it.
SHORT = ["run.accuracy=0.05", "run.duration_s=0.004", "controller.latency_us=20"]
PROMISE = """
def quiet_level(p, s):
    return 0.0 if s.mode == 0 else NO_PROMISE
"""
# A push of so many samples, so many samples after the sphere has left.
LATE = """
from hertzloop.law import NO_PROMISE

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

def quiet_level(p, s):
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
LAWS = [*shipped(), *OWN]
FORCES = {
    "constant": ["controller.force_n=20", "controller.duration_us=200", "controller.delay_us=1400"],
    "profile": ["controller.profile_n=[10.0, 20.0, 30.0]", "controller.lead_us=1"],
    "precomputed": ["controller.precomputed=F_a7", "controller.delay_us=30"],
    "linear": ["controller.numerator=[-100.0, 20.0]", "controller.denominator=[1.0, -0.5]"],
}


@dataclass(frozen=True)
class Shown:
    """What everything says of one law: `run --json`, `inspect --json`, a sweep's case, and Python
    from memory and from the recording."""

    scene: Setup
    run: dict[str, Any]
    inspect: dict[str, Any]
    case: CaseMetrics
    python: "list[hertzloop.Run]"


def scene_of(folder: Path, law: str, *more: str) -> Setup:
    settings = [*SHORT, *FORCES.get(law, []), *more]
    if law.endswith("feedback"):
        settings.append("controller.kappa=0.3")
    path = folder / law if law in OWN else law
    return load("aluminium-20mm", [*settings, f"controller.law={path}"])


def command(*words: str | Path) -> None:
    done = invoke([str(word) for word in words])
    assert done.exit_code == 0, done.output


def shown(folder: Path, scene: Setup) -> Shown:
    toml, recording = folder / "scene.toml", folder / "run.mcap"
    toml.write_text(to_toml(scene.scene), encoding="utf-8")
    command("run", toml, "--transport", "compiled", "--out", recording, "--json", folder / "r.json",
            "--overwrite")  # fmt: skip
    command("inspect", recording, "--json", folder / "i.json")
    run, inspect = (json.loads((folder / name).read_text()) for name in ("r.json", "i.json"))
    python = [hertzloop.simulate(scene.scene), hertzloop.read(recording)]
    return Shown(scene, run, inspect, metrics_of_case(scene), python)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("laws")
    for name, text in OWN.items():
        (found / name).write_text(text, encoding="utf-8")
    return found


@pytest.fixture(scope="module")
def all_shown(folder: Path) -> dict[str, Shown]:
    return {law: shown(folder, scene_of(folder, law)) for law in LAWS}


def pool(toml: str, span: Any, chunks: Any) -> Any:
    """Cases in this process."""
    return (run_chunk(toml, span, chunk) for chunk in chunks)


def same(a: Any, b: Any) -> bool:
    """To the last digit; without a value in both is the same, which JSON says otherwise."""
    none = [x is None or (isinstance(x, float) and not math.isfinite(x)) for x in (a, b)]
    return all(none) if any(none) else bool(a == b)


def check(it: Shown, span: str = "first_impact") -> None:
    """Everything says the same of a span."""
    given, free = it.run[span], it.run["uncontrolled"][span]
    assert all(same(given[key], it.inspect[span][key]) for key in given)
    case = metrics_of_case(it.scene, "run") if span == "whole_run" else it.case
    assert case.contacts == given["contacts"]
    assert case.plate_energy_j == given["plate_energy_j"]
    assert case.rebound_m_s == given["rebound_speed_m_s"]
    assert case.peak_force_n == given["peak_force_n"]
    assert case.contact_us == 1e6 * given["contact_time_s"]
    change = changes_db(SpanMetrics(**given), SpanMetrics(**free))
    for name, key in (
        ("plate_energy_db", "plate_energy_j"), ("radiated_db", "radiated_j"),
        ("plate_speed_db", "plate_speed_max_m_s"), ("pressure_db", "peak_pressure_pa"),
        ("longhorn_db", "longhorn_j"), ("holmes_db", "holmes_j"),
    ):  # fmt: skip
        assert same(getattr(case, name), change[key]), name
    if not math.isnan(case.rebound_percent):
        height, before = given["rebound_height_m"], free["rebound_height_m"]
        assert case.rebound_percent == 100.0 * height / before


@pytest.mark.parametrize("law", LAWS)
def test_everything_says_the_same_of_the_first_impact(
    all_shown: dict[str, Shown], law: str
) -> None:
    it = all_shown[law]
    check(it)
    check(it, "whole_run")
    first, noise, impact = (it.run[k] for k in ("first_impact", "noise", "impacts"))
    assert first["plate_energy_j"] == noise[0]["transmitted_j"] == impact[0]["plate_energy_j"]
    assert first["plate_speed_max_m_s"] == noise[0]["plate_speed_max_m_s"]
    assert same(first["radiated_j"], noise[0]["radiated_j"])
    for found in it.python:
        assert found.impacts[0].plate_energy_j == first["plate_energy_j"]
        assert found.noise[0].plate_speed_max_m_s == first["plate_speed_max_m_s"]
        assert found.noise[0].radiated_j == first["radiated_j"]


def test_laws_push_when_they_are_meant_to(all_shown: dict[str, Shown]) -> None:
    """Otherwise the agreement would say little."""

    def spans(law: str) -> tuple[np.ndarray, int, int, int]:
        scene = all_shown[law].scene
        rows = simulate(scene).truth
        first, *others = impacts_of_truth(scene, rows)
        return rows, first.end, first.over, others[0].start if others else scene.steps

    for law, least, most in (("off", 0, 0), ("late.py", 20, 60), ("again.py", 200, 260)):
        _, end, over, _ = spans(law)
        assert least <= over - end <= most
    _, _, over, following = spans("long.py")
    assert over == following


@pytest.mark.parametrize("law", ["late", "again"])
def test_a_promise_changes_no_metric(all_shown: dict[str, Shown], law: str) -> None:
    without, with_ = (all_shown[f"{law}{end}.py"].case for end in ("", "_promise"))
    speed = {"steps", "digest", "energy_residual"}
    for name in {f.name for f in fields(CaseMetrics)} - speed:
        assert same(getattr(without, name), getattr(with_, name)), name
    assert with_.steps <= without.steps


def test_what_comes_before_the_next_contact_does_not_count(tmp_path: Path) -> None:
    """Laws whose case ends when the sphere is on its way back, or long before; the report page."""
    ahead = tmp_path / "ahead.py"
    ahead.write_text(AHEAD, encoding="utf-8")
    short = ["run.accuracy=0.05", "run.duration_s=0.16", "run.plate_model=modal"]
    for law in ("force_feedback", ahead):
        gain = ["controller.kappa=0.4"] if law != ahead else []
        it = shown(tmp_path, load("aluminium-3mm", [*short, f"controller.law={law}", *gain]))
        assert it.run["whole_run"]["contacts"] > 1
        check(it)
        assert it.case.contacts == 1
        rows = simulate(it.scene).truth
        first, second = impacts_of_truth(it.scene, rows)[:2]
        assert bool(np.any(rows[F_A, first.over : second.start])) == (law == ahead)
    assert it.case.steps < 5000
    page = page_of(read(tmp_path / "run.mcap"))
    columns = [ImpactNoise(**report["noise"][0]) for report in (it.run, it.run["uncontrolled"])]
    assert all(cell in page for row in noise_rows(columns, compare=True) for cell in row)


@pytest.mark.parametrize("more", ["run.touch_phase=0.1", "controller.latency_us=3"])
def test_a_case_on_the_infinite_plate_has_the_metrics_of_a_run_on_it(
    tmp_path: Path, more: str
) -> None:
    scene = load("aluminium-3mm", ["controller.kappa=0.5", "run.duration_s=0.003", more])
    model = metrics_of_case(scene).plate_model
    assert model == "infinite"
    it = shown(tmp_path, scene.vary({"run.plate_model": model}))
    check(it)
    assert asdict(metrics_of_case(scene)) == asdict(it.case)


def test_sweep_tune_and_charts_have_the_metrics_of_the_run(
    all_shown: dict[str, Shown], folder: Path
) -> None:
    it = all_shown["force_feedback"]
    (row,) = evaluate(pool, it.scene, "impact", [{"controller.kappa": 0.3}])
    assert {k: row[k] for k in vars(it.case)} == vars(it.case)
    toml, table = folder / "swept.toml", folder / "swept.csv"
    toml.write_text(to_toml(it.scene.scene), encoding="utf-8")
    command("sweep", toml, "--over", "controller.kappa=0.3,0.2", "--workers", "1", "--out", table)
    page = page_of_results(table)
    assert f"{it.case.plate_speed_db:.3f}" in page
    assert f"{it.case.plate_energy_db:.3f}" in page
    found = best_of(
        pool, [it.scene], ["force_feedback"], (),
        TuneRequest(("plate_energy_db",), generations=1, population=4),
    )  # fmt: skip
    best = metrics_of_case(it.scene.vary(found[0].values))
    assert all(getattr(best, name) == value for name, value in found[0].metrics.items())
    ideal = ("controller.latency_us=0", "run.accuracy=0.05", "run.duration_s=0.004")
    for span in ("impact", "run"):
        named = Named("20mm", "aluminium-20mm", ideal, span)
        law = named.scene().vary({"controller.law": "force_feedback", "controller.kappa": 0.4})
        wanted = metrics_of_case(law, span).plate_energy_db
        assert critical(pool, named, "force_feedback", 2).ideal_db == wanted
        assert energies_of(pool, named, "ideal", "force_feedback")([{}]) == [wanted]


def followed(f_c: list[float], f_a: list[float], gap: list[float], line: int = 0) -> list[int]:
    """Where an impact ends and whether it is over, 3 steps of silence being enough."""
    impact = an.new_follower(3, line)
    an.follow_steps(impact, *(np.array(row, float) for row in (f_c, f_a, gap)))
    return [int(impact.counts[i]) for i in (an.END, an.OVER)]


def test_an_impact_is_over_with_its_last_force_or_the_next_contact() -> None:
    contact, nothing = [1, 1, 0, 0, 0, 0, 0, 0, 0, 0], [0] * 10
    rising = [-1, -1, 1, 2, 3, 4, 5, 6, 7, 8]
    falling = [-1, -1, 1, 2, 3, 4, 3, 2, 1, 0.5]
    late = [0, 0, 0, 0, 0, 0, 0, 0, 0, 9]
    assert followed(contact, nothing, rising) == [2, 0]
    assert followed(contact, [0, 5, 5, 5, 0, 0, 0, 0, 0, 0], rising) == [4, 0]
    assert followed(contact, late, rising) == [10, 0]
    # The sphere is on its way back: such a force meets the next contact.
    assert followed(contact, late, falling) == [2, 1]
    # It was on its way since the contact.
    assert followed(contact, late, falling, line=5) == [10, 0]
    # It has not been silent for long enough.
    assert followed(contact, [0, 0, 0, 0, 0, 0, 9, 0, 0, 9], falling) == [10, 0]
    again = [1, 1, 0, 0, 1, 1, 0, 0, 0, 0]
    assert followed(again, [0, 0, 9, 0, 9, 9, 9, 9, 0, 0], rising) == [3, 1]
