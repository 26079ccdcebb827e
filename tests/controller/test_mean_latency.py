"""The mean latency of the force that acts, against the line itself."""

import numpy as np
import pytest

from hertzloop.controller.controller import Controller, SignalPath, mean_latency_steps
from hertzloop.controller.kernels import EMITTED
from tests.controller.specs import LawSpec

STEPS = 20_000


def simulated(line: SignalPath, every_steps: int, seed: int) -> float:
    """Mean latency of the force when each command is the step of its sample."""
    samples = -(-STEPS // every_steps)
    bound = LawSpec("force_feedback", 1.0, gain=1.0).bound(1e-6)
    controller = Controller(bound, line, 1e-6, STEPS, every_steps, seed)
    controller.process(1.0 + np.arange(samples) * every_steps, look_ahead=False)
    acting = controller.forces[: int(controller.line_state.counts[EMITTED])]
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


def test_jitter_ages_the_force_by_more_than_its_mean():
    assert mean_latency_steps(SignalPath(jitter_steps=20), 200_000, 1, 0) == pytest.approx(
        15.6, abs=0.1
    )
    trace = SignalPath(trace=(0,) * 9 + (20,))
    assert mean_latency_steps(trace, 200_000, 1, 0) == pytest.approx(15.5, abs=0.01)


def test_a_run_without_a_command_has_none():
    assert np.isnan(mean_latency_steps(SignalPath(latency_steps=100), 100, 1, 0))
