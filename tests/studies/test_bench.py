"""The benchmark measures what it says; how fast that is here is not for a test to judge."""

import json
from pathlib import Path

import pytest

from hertzloop.loop.run_options import Transport
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from hertzloop.studies import bench
from tests.hertzloop.processes import hertzloop

SHORT = "run.duration_s=0.0016"


def test_every_transport_and_a_sweep_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    setup = load("aluminium-3mm", [SHORT])
    asked: list[Transport] = []
    walls = {Transport.COMPILED: 0.0016, Transport.INPROCESS: 0.0032, Transport.ZENOH: 0.016}

    def loop_s(_: object, transport: Transport) -> float:
        asked.append(transport)
        return walls[transport] * (10.0 if len(asked) <= len(Transport) else 1.0)

    monkeypatch.setattr(bench, "_loop_s", loop_s)
    rounds: list[tuple[int, int]] = []
    found = bench.measure(setup, quick=True, on_progress=lambda *done: rounds.append(done))
    # All transports take turns, and the first round is not counted.
    assert asked == 3 * list(Transport)
    assert rounds == [(1, 3), (2, 3), (3, 3)]
    by = {loop.transport: loop for loop in found.loops}
    assert by[Transport.COMPILED].median_us == pytest.approx(1.0)
    assert by[Transport.COMPILED].times_real_time == pytest.approx(1.0)
    assert by[Transport.ZENOH].median_us == by[Transport.ZENOH].least_us == pytest.approx(10.0)
    assert by[Transport.ZENOH].times_real_time == pytest.approx(0.1)
    assert found.sweep.cases == 30
    assert 0.0 < found.sweep.per_s <= found.sweep.most_per_s
    assert (found.scene, found.steps, found.rounds) == ("aluminium-3mm", 1600, 2)


def test_latencies_are_multiples_of_the_step_and_shorter_than_the_run() -> None:
    setup = load("aluminium-3mm", [SHORT, "run.step_ns=500"])
    cases = bench.latency_cases(setup, 4)
    assert [case["controller.latency_us"] for case in cases] == [0.0, 0.5, 1.0, 1.5]
    tiny = load("aluminium-3mm", ["run.duration_s=3e-6", "controller.latency_us=0"])
    assert len(bench.latency_cases(tiny, 100)) == 2


def test_cases_that_cannot_be_run_are_an_error() -> None:
    setup = load("aluminium-3mm", [SHORT])
    with pytest.raises(SceneError, match=r"1 of 1 cases cannot be run: controller\.latency_us"):
        bench._cases_per_s(setup, [{"controller.latency_us": -1.0}])


@pytest.mark.full
def test_the_command_prints_and_writes_it(tmp_path: Path) -> None:
    words = ("bench", "aluminium-3mm", "--quick", "--set", SHORT)
    done = hertzloop(*words, "--json", str(tmp_path / "a.json"))
    assert done.returncode == 0, done.stderr
    data = json.loads((tmp_path / "a.json").read_text())
    assert {loop["transport"] for loop in data["loops"]} == {"compiled", "inprocess", "zenoh"}
    assert all(0.0 < loop["least_us"] <= loop["median_us"] for loop in data["loops"])
    last = done.stdout.splitlines()[-1]
    assert last.startswith("Over zenoh the loop takes ")
    assert last.endswith(" cases of a latency sweep in a second.")
