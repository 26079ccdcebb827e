"""The automatic choice of modes on whole random scenes: damper, yield, with and without a law."""

import pytest

from benchmarks import model_order_closed_loop as closed_loop
from benchmarks.random_scenes import drawn


@pytest.mark.full
def test_requests_are_met_by_whole_scenes():
    found = drawn(3, 3, closed_loop.outcomes)
    assert len(found) == 3 * 2 * len(closed_loop.REQUESTS)
    assert {o.law for o in found} == {"off", "slope_threshold"}
    assert len({o.contact for o in found}) > 1
    free = [o for o in found if not o.said]
    assert sum(o.error <= o.request for o in free) >= 0.9 * len(free)
    assert all(o.gap <= o.request and o.rebound <= o.request for o in free)
