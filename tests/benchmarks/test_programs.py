"""Every program runs with --quick, writes CSV files, and ends with its conclusion."""

import csv
import importlib
import os
import re
import shutil

import pytest

from tests.benchmarks.programs import ROOT, called, program, said
from tests.tiers import default

# Programs and how their conclusion begins.
CONCLUSIONS = {
    "benchmarks.budget_agreement": r"Of 1 limits 0 differ from brute force, and the search takes",
    "benchmarks.cases": r"One core runs [\d,]+ cases of the latency map in a second, and \d+%",
    "benchmarks.costs": r"A step in contact over 1104 frequencies takes [\d.]+ us, and an",
    "benchmarks.exported": r"For this processor the exported plant takes [\d.]+ us a step",
    "benchmarks.few_modes": r"On 4 random plates .* and within it [34] times",
    "benchmarks.first_run": r"The kernels of the default scene are \d+ functions, which take",
    "benchmarks.fit_coverage": r"The 95 % intervals hold the true value in [\d.]+ % \(\d+ of 4\)",
    "benchmarks.fit_discrepancy": r"The 95 % intervals hold \d+ % \(\d of 3\) of the true values",
    "benchmarks.held_force": r"The error of the first impact is as expected",
    "benchmarks.infinite_plate": r"The infinite plate is offered in \d+ of 12 requests",
    "benchmarks.jitter_margin": r"In 0 of 21 loops a latency below the jitter margin is unstable",
    "benchmarks.latency": r"In aluminium-3mm \w+ tolerates most latency, \d+ us, \d+ us more than",
    "benchmarks.margin": r"The linear margin agrees in \d+ of \d+ comparisons and differs in 0;",
    "benchmarks.model_order": r"The automatic choice of modes meets the requested accuracy",
    "benchmarks.pictures": r"A picture takes \d+ s at most",
    "benchmarks.random_impacts": r"4 of 4 random impacts agree with Runge-Kutta within the req",
    "benchmarks.real_plant": r"In the real plant \d+ of \d+ laws take energy off the plate",
    "benchmarks.speed_accuracy": r"At an error of 0\.001 the default scheme is [\d.]+ times",
    "benchmarks.start": r"A run of aluminium-3mm takes [\d.]+ s of processor time compiled",
    "benchmarks.stability": r"At steps of 0\.01 to 100 contact times the energy residual",
    "benchmarks.steps": r"A step takes [\d.]+ us at most with one point, and [\d.]+ us with three",
    "benchmarks.validity_map": r"The effect above 0\.1 % in most of the map is: [a-z ]+",
    "paper.tables": r"Over 10 rows, thesis2008 differs from the published levels by a median",
    "paper.weaknesses": r"The contact impulse of the published scheme is at most [\d.]+ %",
}
# Programs of the default tier.
QUICK = ("benchmarks.infinite_plate",)


def test_every_program_is_listed():
    """A module with a function `main` is a program, and can be run."""
    found = set()
    for package in ("benchmarks", "paper"):
        for path in (ROOT / package).glob("*.py"):
            text = path.read_text(encoding="utf-8")
            if "\ndef main(" in text:
                found.add(f"{package}.{path.stem}")
                assert text.endswith(f'\n    start("{package}.{path.stem}")\n')
    assert found == set(CONCLUSIONS)


@pytest.mark.parametrize("name", CONCLUSIONS)
def test_the_help_ends_with_an_example(name):
    result = called(importlib.import_module(name).main, "--help")
    assert result.exit_code == 0
    text = said(result)
    assert "--quick" in text
    assert "-o, --out-dir" in text
    assert f"Example: python -m {name}" in text


@pytest.mark.parametrize("name", default(CONCLUSIONS, QUICK))
def test_a_program_runs_quickly(name, tmp_path):
    if name == "benchmarks.exported" and not shutil.which("cc"):
        pytest.skip("needs a C compiler")
    done = program(name, "--quick", "-o", str(tmp_path / "made"))
    if "CI" not in os.environ and "graphics driver" in done.stderr:
        pytest.skip("no Vulkan driver here")
    assert done.returncode == 0, done.stderr
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


@pytest.mark.parametrize("name", CONCLUSIONS)
def test_a_folder_that_cannot_be_made_is_said_before_work_starts(name, monkeypatch):
    """In /proc not even root can make a file."""

    def work(*_: object) -> None:
        raise AssertionError("work has started")

    monkeypatch.setattr("hertzloop.warmup.ensure_compiled", work)
    result = called(importlib.import_module(name).main, "-o", "/proc/no")
    assert result.exit_code == 2, result.output
    assert "/proc/no" in said(result)
