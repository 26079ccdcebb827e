"""What a law's file does before a run is given up in time, and nothing stays of that."""

import time
from contextlib import suppress

import pytest

from hertzloop.controller.loading.callbacks import LawTimeout, given_up_in_time


@pytest.mark.parametrize("late_s", [-1e-4, 0.0])
def test_at_the_last_moment_it_is_over_or_overdue_once(late_s):
    """Whichever comes first, what follows is not interrupted any more."""
    patience_s, interrupted = 0.003, 0
    for _ in range(50):
        with suppress(LawTimeout), given_up_in_time(patience_s):
            until = time.perf_counter() + patience_s + late_s
            while time.perf_counter() < until:
                pass
        try:
            for _ in range(1000):
                pass
        except LawTimeout:
            interrupted += 1
    assert interrupted == 0
