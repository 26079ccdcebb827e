"""The benchmark measures what it says; how fast that is here is not for a test to judge."""

import json

import pytest

from hertzloop.scene.setup import load
from hertzloop.studies.bench import bench
from tests.hertzloop.commands import hertzloop

SHORT = "run.duration_s=0.0016"


def test_latencies_are_multiples_of_the_step_and_shorter_than_the_run():
    setup = load("aluminium-3mm", [SHORT, "run.step_ns=500"])
    cases = bench.latency_cases(setup, 4)
    assert [case["controller.latency_us"] for case in cases] == [0.0, 0.5, 1.0, 1.5]
    tiny = load("aluminium-3mm", ["run.duration_s=3e-6", "controller.latency_us=0"])
    assert len(bench.latency_cases(tiny, 100)) == 2


@pytest.mark.full
def test_the_command_prints_and_writes_it(tmp_path):
    words = ("bench", "aluminium-3mm", "--quick", "--set", SHORT)
    done = hertzloop(*words, "--json", str(tmp_path / "a.json"))
    data = json.loads((tmp_path / "a.json").read_text())
    assert {loop["transport"] for loop in data["loops"]} == {"compiled", "inprocess", "zenoh"}
    assert all(0.0 < loop["least_us"] <= loop["median_us"] for loop in data["loops"])
    last = done.stdout.splitlines()[-1]
    assert last.startswith("Over zenoh the loop takes ")
    assert last.endswith(" cases of a latency sweep in a second.")
