"""The least sample that a sensor may still show: every option of a channel has its part in it."""

import math
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from hertzloop.sensors import kernels as k
from hertzloop.sensors.acquisition import (
    LINEAR_FIELDS,
    SMOOTH_FIELDS,
    STATED_FIELDS,
    Fault,
    Sensor,
    SensorSpec,
)

STEP_S, STEPS = 1e-6, 6000
LAST_CONTACT = 1200  # where the gap may begin to rise for good
FAULTS = [
    Fault("stuck", 1500),
    Fault("stuck", 1500, 300),
    Fault("offset", 2000, 400, size=-3e-4),
    Fault("offset", 3000, size=1e-4),
    Fault("spikes", size=-1e-3, probability=0.2),
    Fault("drop_outs", 5, 50, probability=0.1),
    Fault("drop_outs", 0, probability=0.9),
    Fault("saturation", 1500, size=2e-5),
]
# Options of a channel; the first field of each is the one that is tried.
OPTIONS: list[dict[str, Any]] = [
    {"of_state": 0},
    {"every_steps": 7},
    *({"low_pass_hz": hz} for hz in (3e3, 2e4, 2e5)),
    {"low_pass": "bessel", "low_pass_hz": 2e4, "low_pass_order": 4},
    *({"low_pass_order": n, "low_pass_hz": 3e4} for n in range(2, 9)),
    *({"noise_rms": noise} for noise in (1e-6, 1e-5)),
    *({"fault": fault} for fault in FAULTS),
    {"full_scale": (-1e-4, 5e-5)},
    {"bits": 8, "full_scale": (-1e-4, 1e-3)},
    *({"ac_coupling_hz": hz} for hz in (1.0, 5e3)),
    *({"resonance_hz": 1e4, "resonance_damping": d} for d in (0.02, 0.7)),
    {"resonance_damping": 0.7, "resonance_hz": 3e4},
]


def gaps(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A gap (m) that falls, touches, and from a step on is never below half of its largest value
    since; and that half at each step, NaN before. It goes to both ends of what is allowed."""
    falling = np.linspace(1e-3, 0.0, 1000)
    before = rng.uniform(-1e-5, 3e-5, LAST_CONTACT - 1000)
    gap, half = np.concatenate([falling, before, np.zeros(STEPS - LAST_CONTACT)]), np.zeros(STEPS)
    half[:LAST_CONTACT] = math.nan
    widest, hold, up = 5e-5, 0, True
    for i in range(LAST_CONTACT, STEPS):
        if hold == 0:
            hold, up = int(rng.integers(1, 60)), not up
            growth = rng.choice([1.0, 1.001, 1.3]) if widest < 0.1 else 1.0
        hold -= 1
        value = widest * growth if up else 0.5 * widest
        widest = max(widest, value)
        gap[i], half[i] = value, 0.5 * widest
    return gap, half


def check(spec: SensorSpec, seed: int) -> int:
    """No sample is below the least one that was known before it. Returns how often one was."""
    gap, half = gaps(np.random.default_rng(seed))
    sensor = Sensor(spec, STEP_S, STEPS, seed)
    samples, least, index = [], [], 0
    for i in range(STEPS):
        k.follow(sensor.model, sensor.state, gap[i])
        if i % spec.every_steps:
            continue
        samples.append(k.sample(sensor.model, sensor.state, index)[1])
        index += 1
        since = i - LAST_CONTACT
        asked = k.least_sample(sensor.model, sensor.state, index, half[i], since)
        least.append(asked if since >= 0 else -math.inf)
    # What is known at a sample holds for all that come.
    known = np.maximum.accumulate(least)[:-1]
    assert np.all(np.array(samples)[1:] >= known - 1e-15)
    return int(np.sum(known > -math.inf))


@pytest.mark.parametrize("option", OPTIONS, ids=str)
def test_no_sample_is_below_the_least_one(option):
    known = [check(SensorSpec(**option), seed) for seed in (1, 2)]
    assert (min(known) > 0) == (next(iter(option)) in STATED_FIELDS)


def test_every_option_of_a_channel_is_tried_here():
    """A new option fails here until its part in the least sample is stated and tried; until then
    the least sample is unknown where it is set."""
    tried = {next(iter(option)) for option in OPTIONS}
    assert tried == {part.name for part in fields(SensorSpec)}
    assert tried >= STATED_FIELDS | LINEAR_FIELDS | SMOOTH_FIELDS


def test_a_quantity_without_a_least_value_has_no_least_sample():
    sensor = Sensor(SensorSpec(full_scale=(-1.0, 1.0), bits=8), STEP_S, 1, 1)
    for least in (-math.inf, math.nan, 0.0):
        assert k.least_sample(sensor.model, sensor.state, 1, least, 10**6) == -math.inf
