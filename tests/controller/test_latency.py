"""The latency of a controller with its own clock, by sample, and the mean latency of a line."""

from fractions import Fraction
from math import floor

import numpy as np
import pytest

from hertzloop.controller.controller import (
    Controller,
    SignalPath,
    latency_steps,
    mean_latency_steps,
)
from hertzloop.controller.kernels import EMITTED
from hertzloop.loop.answering import answer_samples
from tests.controller.specs import LawSpec


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


def test_the_bound_holds_at_any_drift():
    for ppm in (1e5, -1e5, 3.0, -3.0):
        path = line(10, ppm, 0.7)
        assert latency_steps(path, 100_000, 10, 1).max() <= path.most_added_steps
        assert path.varies


STEPS = 20_000


def simulated(line: SignalPath, every_steps: int, seed: int) -> float:
    """Mean latency of the force when each command is the step of its sample."""
    samples = -(-STEPS // every_steps)
    bound = LawSpec("force_feedback", 1.0, gain=1.0).bound(1e-6)
    controller = Controller(bound, line, 1e-6, STEPS, every_steps, seed)
    answer_samples(controller, 1.0 + np.arange(samples) * every_steps, commands_ahead=False)
    acting = controller.forces[: int(controller.path_state.counts[EMITTED])]
    step = np.arange(len(acting))
    begun = acting > 0.0
    age = step - (acting - 1.0) - 1.0 - 0.5 * (every_steps - 1)
    return float(age[begun].mean())


@pytest.mark.parametrize("every_steps", [1, 7])
@pytest.mark.parametrize(
    "line",
    [
        SignalPath(),
        SignalPath(latency_steps=5),
        SignalPath(jitter_steps=20),
        SignalPath(latency_steps=3, trace=(0,) * 9 + (20,)),
        SignalPath(trace=(0, 20, 5), resampled=True, dead_steps=2),
        SignalPath(drop_out_probability=0.5),
        SignalPath(tick_steps=7.01, first_tick_steps=2.0),
    ],
)
def test_it_is_that_of_the_forces(line, every_steps):
    expected = simulated(line, every_steps, seed=3)
    # The last few commands may still be in the line when the block of samples ends.
    assert mean_latency_steps(line, STEPS, every_steps, 3) == pytest.approx(expected, abs=0.02)


def test_a_run_without_a_command_has_none():
    assert np.isnan(mean_latency_steps(SignalPath(latency_steps=100), 100, 1, 0))
