"""The automatic choice of modes on random scenes."""

from benchmarks import model_order as study
from benchmarks.random_scenes import drawn


def test_requests_are_met_on_random_scenes():
    found = drawn(10, 3, study.outcomes)
    assert len(found) == 30
    free = [o for o in found if not o.capped]
    assert len(free) > 20
    met = [o for o in free if o.error <= o.request]
    assert len(met) >= 0.9 * len(free)  # 95 % of many; two of a few may miss
    assert max(o.error / o.request for o in free) < 3.0
    # The fewest modes are those of a sphere alone; the choice carries the forces of a law as well.
    assert max(o.times_cheapest for o in met) < 3.0
    # A request ten times tighter costs more modes, and gets a smaller error.
    coarse, fine = ({o.scene: o for o in found if o.request == request} for request in (1e-2, 1e-4))
    assert all(fine[i].frequencies > coarse[i].frequencies for i in coarse)
    assert all(fine[i].gap_error < coarse[i].gap_error for i in coarse)
