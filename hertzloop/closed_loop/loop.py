"""The one compiled loop: sensor, law, signal path and plant, a step after the other.

All transports, sweeps and studies run it, with another exchange each. So the samples are the same
bits. Nothing allocates.
"""

from typing import Any, NamedTuple

import numpy as np

from hertzloop.closed_loop.exchange import (
    GO,
    IMPACT_OVER,
    OBSERVED,
    SAMPLES_END,
    SAMPLES_FIRST,
    TRUTH_END,
    TRUTH_FIRST,
    await_step,
    force_for,
    is_over,
    put,
)
from hertzloop.common.jit import kernel
from hertzloop.plant.state_kernels import STEP, XI
from hertzloop.plant.time_series import record_step
from hertzloop.sensors import kernels as sensor_kernels
from hertzloop.sensors.kernels import SensorModel


class PlantSide(NamedTuple):
    """Plant and sensor at their present step.

    Attributes:
        plant, plant_state: Of the plant's scheme.
        sensor, sensor_state: Data-acquisition channel.
        parts_of_step: Steps of the plant in a step of the loop, under one command.
        sensed_mean: Whether the sensor follows the mean over these, else their end.
    """

    plant: Any
    plant_state: Any
    sensor: SensorModel
    sensor_state: np.ndarray
    parts_of_step: int = 1
    sensed_mean: bool = False


@kernel
def run(side, exchange, unsent, end):
    """Run to step `end`, or as far as the exchange lets it; return its status."""
    body, counts = side.plant_state.body, unsent.counts
    step = side.plant_state.counts[STEP] // side.parts_of_step
    sensed = body[side.sensor.of_state]
    while True:
        status = await_step(exchange, unsent, step, end)
        if status != GO:
            return status
        if counts[OBSERVED] <= step:
            counts[OBSERVED] = step + 1
            sensor_kernels.follow(side.sensor, side.sensor_state, sensed)
            if counts[SAMPLES_END] * side.sensor.every_steps == step:
                put(exchange, unsent, step, take_sample(side, unsent))
        command, status = force_for(exchange, unsent, step, end)
        if status != GO:
            return status
        gap, total = body[XI], 0.0
        for _ in range(side.parts_of_step):
            row = counts[TRUTH_END] - counts[TRUTH_FIRST]
            record_step(side.plant, side.plant_state, command, unsent.truth, row)
            counts[TRUTH_END] += 1
            total += body[side.sensor.of_state]
        step += 1
        sensed = body[side.sensor.of_state]
        if side.sensed_mean:
            sensed = total / side.parts_of_step
        if is_over(exchange, side, unsent, gap):
            return IMPACT_OVER


@kernel(copied=True)
def take_sample(side, unsent):
    """Take the next sample, and return its value in the unit of its quantity."""
    counts = unsent.counts
    index = counts[SAMPLES_END]
    at = index - counts[SAMPLES_FIRST]
    code, value, clipped = sensor_kernels.sample(side.sensor, side.sensor_state, index)
    unsent.codes[at] = code
    unsent.values[at] = value
    unsent.clipped[at] = clipped
    counts[SAMPLES_END] = index + 1
    return value
