"""The benchmark measures what it says; how fast that is here is not for a test to judge."""

from studies import baseline


def test_step_and_exchange_costs() -> None:
    steps = baseline.step_costs(rounds=2)
    assert [cost.case.split(",")[1] for cost in steps[1:3]] == [" flight", " contact"]
    exchanges = baseline.exchange_costs(rounds=2)
    assert "zenoh port between processes" in [cost.case for cost in exchanges]
    for cost in steps + exchanges:
        assert 0 < cost.least_us <= cost.median_us
    assert steps[0].ratio == exchanges[0].ratio == 1.0
