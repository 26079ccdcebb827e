"""The benchmarks measure what they say; how fast that is here is not for a test to judge."""

import pytest

from benchmarks import costs


@pytest.mark.full
def test_step_and_exchange_costs():
    steps, exchanges = costs.measure(2).values()
    assert [cost.case.split(",")[0] for cost in steps[1:3]] == ["flight", "contact"]
    assert [cost.case for cost in exchanges] == ["zenoh port"]
    for cost in steps + exchanges:
        assert 0 < cost.least_us <= cost.median_us
    assert steps[0].ratio == exchanges[0].ratio == 1.0
