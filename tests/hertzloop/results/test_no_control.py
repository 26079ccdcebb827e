"""What is said of runs with nothing to compare, and of balance that no energy follows from."""

import math

import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.scene.build import free_series
from hertzloop.scene.setup import load
from tests.commands import call
from tests.hertzloop.scenes import json_in
from tests.recordings.rewriting import Sent, record, rewrite


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return record(tmp_path_factory.mktemp("whole") / "a.mcap", compiled=True)


@pytest.mark.full
def test_a_balance_that_is_not_finite_is_told_of(whole, tmp_path):
    def change(sent: Sent) -> None:
        if sent.stream == "balance":
            sent.header.injected_j = math.nan

    path = rewrite(whole, tmp_path / "b.mcap", change)
    done = call("inspect", str(path), "--json", str(tmp_path / "b.json"))
    assert done.exit_code == 1
    said = "stream 'balance' sequence 0 holds injected_j = nan"
    assert said in " ".join(done.stdout.split()), done.stdout
    found = json_in(tmp_path / "b.json")
    assert not found["complete"]
    assert any(said in problem for problem in found["problems"])
    assert found["impacts"]


def test_uncontrolled_rows_are_those_of_a_run_without_control():
    for name in ("aluminium-20mm", "offcentre-6mm", "thesis-aluminium"):
        scene = load(name, ["controller.law=off"])
        assert free_series(scene).tobytes() == simulate(scene).truth.tobytes()
