"""The benchmark measures what it says; how fast that is here is not for a test to judge."""

import os
from pathlib import Path

import pytest

from benchmarks import baseline, costs, exchange, replay
from benchmarks.baseline import run_beside
from benchmarks.cases import mode_file_costs
from hertzloop.scene.setup import load


@pytest.mark.full
def test_step_and_exchange_costs() -> None:
    steps = baseline.step_costs(rounds=2)
    assert [cost.case.split(",")[1] for cost in steps[1:3]] == [" flight", " contact"]
    exchanges = baseline.exchange_costs(rounds=2)
    assert "zenoh port between processes" in [cost.case for cost in exchanges]
    for cost in steps + exchanges:
        assert 0 < cost.least_us <= cost.median_us
    assert steps[0].ratio == exchanges[0].ratio == 1.0


@pytest.mark.full
def test_ways_on_one_host() -> None:
    found = costs.link_costs(rounds=1), costs.opening_costs(rounds=1)
    for group in found:
        assert [cost.case for cost in group] == ["loopback", "Unix sockets", "TLS on loopback"]
        assert all(cost.least_us > 0 for cost in group)
    [made] = costs.certificate_costs(rounds=1)
    assert made.least_us > 0


@pytest.mark.full
def test_plates_by_their_modes() -> None:
    found = mode_file_costs(rounds=2)
    counts = [int(cost.case.split()[-2]) for cost in found]
    assert counts[1:3] == counts[3:5]  # all modes of the plate
    assert counts[5:] == [100, 100]
    assert all(cost.least_us > 0 for cost in found)


@pytest.mark.full
@pytest.mark.parametrize("pause_s", [None, 0.0, 0.5])
def test_a_run_beside_a_stranger(pause_s: float | None) -> None:
    scene = load("aluminium-3mm", ["run.duration_s=0.0016", "run.accuracy=0.1"])
    assert run_beside(scene, pause_s)() > 0


@pytest.mark.full
def test_a_replay_and_its_frames() -> None:
    found = replay.measure(rounds=1, duration_s=0.0016)
    assert found.steps == 1600
    assert found.megabytes > 0
    if "no graphics driver" in found.no_frames and "CI" not in os.environ:
        pytest.skip("no Vulkan driver here")
    assert (len(found.cases), found.no_frames) == (4, "")
    for row in found.cases:
        assert 0 < row.least <= row.median


@pytest.mark.full
def test_exchanges_of_all_ways_that_are_installed(tmp_path: Path) -> None:
    found = exchange.measure(rounds=1)
    ways = {row.way for row in found.rows}
    assert {"hertzloop, fast lane", "hertzloop, zenoh port", "multiprocessing Pipe"} <= ways
    assert len(ways) + len(found.left_out) == 6
    for row in found.rows:
        assert 0 < row.least_us <= row.median_us
    for way in found.left_out:
        assert found.left_out[way]
    exchange.draw(found, tmp_path / "exchange.png")
    assert (tmp_path / "exchange.png").stat().st_size > 1000
