"""The benchmarks measure what they say; how fast that is here is not for a test to judge."""

import os

import pytest

from benchmarks import costs, replay


@pytest.mark.full
def test_step_and_exchange_costs() -> None:
    steps, exchanges = costs.measure(2).values()
    assert [cost.case.split(",")[1] for cost in steps[1:3]] == [" flight", " contact"]
    assert [cost.case for cost in exchanges] == ["TCP", "zenoh port"]
    for cost in steps + exchanges:
        assert 0 < cost.least_us <= cost.median_us
    assert steps[0].ratio == exchanges[0].ratio == 1.0


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
