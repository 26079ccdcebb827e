"""Programs run with --quick, write CSV files, and end with their conclusion."""

import csv
import importlib
import re

import pytest

from benchmarks import case_rounds
from tests.benchmarks.programs import ROOT, called
from tests.tiers import default

# Programs that are run, and how their conclusion begins.
CONCLUSIONS = {
    "benchmarks.budget_agreement": r"Of 1 limits 0 differ from brute force, and the search takes",
    "benchmarks.cases": r"One core runs [\d,]+ cases of the latency map in a second, and \d+%",
    "benchmarks.costs": r"A step in contact over 1104 frequencies takes [\d.]+ us, and an",
    "benchmarks.fit_coverage": r"The 95 % intervals hold the true value in [\d.]+ % \(\d+ of 4\)",
    "benchmarks.fit_discrepancy": r"The 95 % intervals hold \d+ % \(\d of 3\) of the true values",
    "benchmarks.infinite_plate": r"The infinite plate is offered in \d+ of 12 requests",
    "benchmarks.random_impacts": r"4 of 4 random impacts agree with Runge-Kutta within the req",
    "benchmarks.real_plant": r"In the real plant \d+ of \d+ laws take energy off the plate",
    "benchmarks.speed_accuracy": r"At an error of 0\.001 the default scheme is [\d.]+ times",
    "benchmarks.start": r"A run of aluminium-3mm takes [\d.]+ s of processor time compiled",
    "benchmarks.steps": r"A step takes [\d.]+ us at most with one point, and [\d.]+ us with three",
    "benchmarks.validity_map": r"The effect above 0\.1 % in most of the map is: [a-z ]+",
}
# Programs of the default tier.
QUICK = ("benchmarks.infinite_plate",)
# Programs that do no more than print what other tests compute by their functions, or compile all
# kernels anew.
ELSEWHERE = {
    *(f"benchmarks.{name}" for name in ("exported", "few_modes", "first_run", "held_force")),
    *(f"benchmarks.{name}" for name in ("jitter_margin", "latency", "margin", "model_order")),
    *("benchmarks.pictures", "benchmarks.stability", "paper.tables", "paper.weaknesses"),
}
MORE = {"benchmarks.budget_agreement": ["aluminium-3mm"]}


def test_every_program_is_listed():
    """A module with a function `main` is a program, and can be run."""
    found = set()
    for package in ("benchmarks", "paper"):
        for path in (ROOT / package).glob("*.py"):
            text = path.read_text(encoding="utf-8")
            if "\ndef main(" in text:
                found.add(f"{package}.{path.stem}")
                assert text.endswith(f'\n    start("{package}.{path.stem}")\n')
    assert found == CONCLUSIONS.keys() | ELSEWHERE


@pytest.mark.usefixtures("shipped_scenes")
@pytest.mark.parametrize("name", default(CONCLUSIONS, QUICK))
def test_a_program_runs_quickly(name, tmp_path, monkeypatch):
    few = {case_rounds.LATENCY_MAP: ["controller.latency_us=0:9:1"]}
    monkeypatch.setattr(case_rounds, "OVER", few)  # of the whole sweep
    words = [*MORE.get(name, []), "--quick", "-o", str(tmp_path / "made")]
    done = called(importlib.import_module(name).main, *words)
    assert done.exit_code == 0, done.output
    last = done.stdout.splitlines()[-1]
    assert re.match(CONCLUSIONS[name], last), last
    assert last.endswith(".")
    made = {path.suffix for path in (tmp_path / "made").iterdir()}
    assert {".csv"} <= made <= {".csv", ".png"}
    for path in (tmp_path / "made").glob("*.csv"):
        with path.open(newline="") as file:
            rows = list(csv.reader(file))
        assert len(rows) > 1, path
        assert len({len(row) for row in rows}) == 1, path
    assert f"{tmp_path / 'made'}/" in done.stdout  # what was written
