"""Compiled kernels of the data acquisition."""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.jit import kernel

FILTERED, STARTED, LAST = range(3)  # indices into the state; the last: of a channel with a fault
STATE_SIZE = 3
HELD, ADDED, LIMITED = range(1, 4)  # what a fault does to a sample; 0: nothing


class SensorModel(NamedTuple):
    """What does not change: see hertzloop.sensors.acquisition.SensorSpec for the meaning."""

    of_state: int
    every_steps: int
    filter_gain: float  # 1 - exp(-2 pi f_c h); 1 without a filter
    ideal: bool
    limited: bool
    low: float
    high: float
    scale: float
    offset: float
    first_code: int
    last_code: int
    noise: np.ndarray  # one value a sample, in units of the quantity; empty without noise
    fault: np.ndarray  # what is wrong with each sample; empty without a fault
    fault_size: float


@kernel(inline=True)
def quantise(value, scale, offset, first_code, last_code):
    """Nearest code of a mid-tread converter, ties upwards, clipped to its codes."""
    code = math.floor((value - offset) / scale + 0.5)
    return min(max(code, first_code), last_code)


@kernel(inline=True)
def follow(model, state, value):
    """One-pole low-pass, stepped at every simulation step; starts at its first input.

    Without a filter the value itself: adding the difference would round it.
    """
    if state[STARTED] == 0.0 or model.filter_gain == 1.0:
        state[STARTED] = 1.0
        state[FILTERED] = value
    else:
        state[FILTERED] += model.filter_gain * (value - state[FILTERED])


@kernel(inline=True)
def sample(model, state, index):
    """Convert the filtered value: code (0 if ideal), value as read, 1 if clipped."""
    value = state[FILTERED]
    if model.noise.size > 0:
        value += model.noise[index]
    if model.fault.size > 0:
        kind = model.fault[index]
        if kind == HELD:
            value = state[LAST]
        elif kind == ADDED:
            value += model.fault_size
        elif kind == LIMITED:
            value = min(max(value, -abs(model.fault_size)), abs(model.fault_size))
        state[LAST] = value
    clipped = 0
    if model.limited:
        if value < model.low or value > model.high:
            clipped = 1
        value = min(max(value, model.low), model.high)
    if model.ideal:
        return 0, value, clipped
    code = quantise(value, model.scale, model.offset, model.first_code, model.last_code)
    return code, model.offset + model.scale * code, clipped
