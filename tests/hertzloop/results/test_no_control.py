"""What is said of runs with nothing to compare, and of balance that no energy follows from."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.scene.build import free_series
from hertzloop.scene.setup import load
from tests.commands import call, succeed
from tests.recordings.rewriting import Sent, record, rewrite

COMPILED = ["--transport", "compiled", "--set", "run.accuracy=0.05"]


@pytest.mark.full
def test_a_run_without_control_has_one_table(tmp_path: Path) -> None:
    words = ["--details", *COMPILED, "--set", "run.duration_s=0.0015", "--out"]
    words.append(str(tmp_path / "a.mcap"))
    report = tmp_path / "a.json"
    off = ["--set", "controller.law=off", "--json", str(report)]
    alone = call("run", "aluminium-3mm", *words, *off)
    both = call("run", "aluminium-3mm", *words, "--overwrite")
    assert alone.exit_code == both.exit_code == 0, alone.output + both.output
    for title in ("Impacts with control", "The same without control", "dB"):
        assert title not in alone.stdout
        assert title in both.stdout
    assert alone.stdout.count("Impacts, no control") == 1
    data = json.loads(report.read_text())
    assert data["law"] == "off"
    for kind in ("impacts", "noise", "stability"):
        assert data["uncontrolled"][kind] == data[kind]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("whole") / "a.mcap", compiled=True)


@pytest.mark.full
def test_a_balance_that_is_not_finite_is_told_of(whole: Path, tmp_path: Path) -> None:
    def change(sent: Sent) -> None:
        if sent.stream == "balance":
            sent.header.injected_j = math.nan

    path = rewrite(whole, tmp_path / "b.mcap", change)
    done = call("inspect", str(path), "--json", str(tmp_path / "b.json"))
    assert done.exit_code == 1
    said = "the energy balance holds injected_j = nan"
    assert said in " ".join(done.stdout.split())
    found = json.loads((tmp_path / "b.json").read_text())
    assert not found["complete"]
    assert any(said in problem for problem in found["problems"])
    assert found["impacts"]


def test_an_error_that_nobody_knows_is_no_damage(whole: Path, tmp_path: Path) -> None:
    def change(sent: Sent) -> None:
        if sent.stream == "balance":
            sent.header.expected_error = math.inf

    path = rewrite(whole, tmp_path / "b.mcap", change)
    assert "Complete" in succeed("inspect", str(path))


def test_uncontrolled_rows_are_those_of_a_run_without_control() -> None:
    """They come in pieces, whose memory does not grow with the run."""
    for name in ("aluminium-20mm", "offcentre-6mm", "thesis-aluminium"):
        scene = load(name, ["controller.law=off"])
        firsts, pieces = zip(*free_series(scene), strict=True)
        assert list(firsts) == [n * pieces[0].shape[1] for n in range(len(pieces))]
        assert np.concatenate(pieces, axis=1).tobytes() == simulate(scene).truth.tobytes()
