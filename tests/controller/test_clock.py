"""A controller that acts by its own clock: the latency by sample, against closed forms."""

from fractions import Fraction
from math import floor

import numpy as np
import pytest

from hertzloop.controller.controller import SignalPath, latency_steps, mean_latency_steps


def line(every_steps: int, ppm: float, phase: float, least: int = 0) -> SignalPath:
    tick = every_steps / (1.0 + 1e-6 * ppm)
    return SignalPath(least, tick_steps=tick, first_tick_steps=phase * tick)


def latencies(every_steps: int, ppm: float, phase: float, samples: int) -> np.ndarray:
    path = line(every_steps, ppm, phase)
    return latency_steps(path, samples * every_steps, every_steps, seed=1)


@pytest.mark.parametrize("phase", ["0", "0.3", "0.999"])
@pytest.mark.parametrize("ppm", [10_000, -10_000, 300, -7])
@pytest.mark.parametrize("every_steps", [1, 8, 100])
def test_a_command_waits_for_the_first_tick_at_or_after_its_sample(every_steps, ppm, phase):
    tick = Fraction(every_steps) / (1 + Fraction(ppm, 10**6))
    first = Fraction(phase) * tick
    exact = []
    for taken in range(0, 700 * every_steps, every_steps):
        number = max(0, -((first - taken) // tick))
        exact.append(floor(first + number * tick - taken + Fraction(1, 2)))
    assert latencies(every_steps, ppm, float(phase), 700).tolist() == exact


@pytest.mark.parametrize("ppm", [50.0, -50.0])
@pytest.mark.parametrize("every_steps", [1, 8, 100])
def test_over_a_beat_the_latency_is_a_sawtooth_over_one_period(every_steps, ppm):
    beat = round(1e6 / abs(ppm))  # samples in which the clocks drift by one period
    found = latencies(every_steps, ppm, 0.3, 4 * beat)
    assert found.mean() == pytest.approx(every_steps / 2, rel=1e-3)
    assert (found.min(), found.max()) == (0, every_steps)
    assert np.array_equal(found[:beat], found[beat : 2 * beat])
    returns = np.flatnonzero(np.abs(np.diff(found)) > every_steps / 2)
    if every_steps > 1:
        assert np.all(np.abs(np.diff(returns) - beat) <= 1)
        assert np.all(np.sign(np.diff(found)[returns]) == np.sign(ppm))  # a fast clock ticks sooner
    mean = mean_latency_steps(
        line(every_steps, ppm, 0.3, 5), 4 * beat * every_steps, every_steps, 1
    )
    assert mean == pytest.approx(5 + every_steps / 2, rel=1e-3)


def test_the_bound_holds_at_any_drift():
    for ppm in (1e5, -1e5, 3.0, -3.0):
        path = line(10, ppm, 0.7)
        assert latency_steps(path, 100_000, 10, 1).max() <= path.most_added_steps
        assert path.varies


def test_jitter_and_clock_add_up():
    both = SignalPath(2, jitter_steps=5, tick_steps=10.1, first_tick_steps=3.0)
    parts = SignalPath(2, jitter_steps=5), SignalPath(tick_steps=10.1, first_tick_steps=3.0)
    jitter, clock = (latency_steps(part, 5000, 10, 3) for part in parts)
    assert np.array_equal(latency_steps(both, 5000, 10, 3), jitter + clock)
