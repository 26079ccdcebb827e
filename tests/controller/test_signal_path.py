"""The signal path from command to actuator: latency, sampling, jitter, drop-outs, slew."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

from hertzloop.controller.controller import SignalPath
from tests.controller.drive import commands, drive
from tests.controller.strategies import EVERY_STEPS, LATENCIES, LAWS, SEQUENCES
from tests.controller.test_law import PROFILE

COUNTING = replace(PROFILE, profile_n=tuple(float(i) for i in range(1, 2001)))
ALWAYS_TOUCHING = [-1.0] * 2000


def newest_command(forces: np.ndarray) -> np.ndarray:
    """Which sample's command acts at each step of a run of the law COUNTING; -1 before any."""
    return forces.astype(int) - 1


@given(LAWS, SEQUENCES, LATENCIES, EVERY_STEPS)
@settings(max_examples=100, deadline=None)
def test_sample_k_acts_from_the_step_after_it_plus_latency(law, samples, latency, every_steps):
    """Step by step: the command in force is that of the newest sample that may act by then."""
    path = SignalPath(latency_steps=latency)
    forces = drive(law, path, samples, every_steps=every_steps).forces
    by_sample = commands(law, samples)
    assert len(forces) == len(samples) * every_steps + 1 + latency
    for step, force in enumerate(forces):
        # Sample i is taken at step i * every_steps.
        acting = [i for i in range(len(samples)) if i * every_steps + 1 + latency <= step]
        assert force == (by_sample[acting[-1]] if acting else 0.0)


@pytest.mark.parametrize("latency", [0, 4])
def test_jitter_stays_in_range_and_keeps_the_order(latency):
    path = SignalPath(latency_steps=latency, jitter_steps=3)
    newest = newest_command(drive(COUNTING, path, ALWAYS_TOUCHING).forces)
    assert np.all(np.diff(newest) >= 0)
    steps = np.arange(len(newest))
    started = steps > latency + 3
    lateness = (steps - 1 - latency - newest)[started]
    # Each of the 4 values occurs, none beyond: at any step the newest command is at most 3
    # steps late, and a command that is not late at all acts at once.
    assert set(lateness.tolist()) == {0, 1, 2, 3}


def test_a_lost_command_leaves_the_last_force():
    path = SignalPath(drop_out_probability=0.25)
    newest = newest_command(drive(COUNTING, path, ALWAYS_TOUCHING).forces)[1:]
    arrived = newest == np.arange(len(newest))
    held = np.maximum.accumulate(np.where(arrived, np.arange(len(newest)), -1))
    assert np.array_equal(newest, held)
    # 2000 draws: six standard deviations of the binomial distribution are 116.
    assert abs(np.count_nonzero(~arrived) - 500) < 116


@pytest.mark.parametrize(
    ("wanted", "slew", "expected"),
    [
        ((4, 4, 4, 4, 4), 1.5, [0, 1.5, 3, 4, 4, 4, 2.5, 1, 0, 0]),
        ((-4, -4, 4, 4), 3.0, [0, -3, -4, -1, 2, 0, 0, 0]),
        ((2, 2), 2.0, [0, 2, 2, 0, 0]),
    ],
)
def test_slew_limit(wanted, slew, expected):
    law = replace(PROFILE, profile_n=wanted)
    samples = [-1.0] * (len(expected) - 1)
    assert drive(law, SignalPath(slew_n_s=slew), samples).forces.tolist() == expected


def test_slew_is_per_second_not_per_sample():
    """Two steps a second, a sample every second: half the rate in a step."""
    law = replace(PROFILE, profile_n=(4.0, 4.0, 4.0))
    driven = drive(law, SignalPath(slew_n_s=2.0), [-1.0] * 4, every_steps=2)
    assert driven.forces.tolist() == [0, 1, 2, 3, 4, 4, 4, 3, 2]
