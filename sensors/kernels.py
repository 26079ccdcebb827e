"""Compiled kernels of the data acquisition."""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.jit import kernel

# Indices into the state. RESONANT: output of the sensor's own resonance, RESONANT_RATE: its rate
# over w; COUPLED: the mean that AC coupling takes away; LAST: of a channel with a fault.
FILTERED, STARTED, RESONANT, RESONANT_RATE, COUPLED, LAST = range(6)
STATE_SIZE = 6
HELD, ADDED, LIMITED = range(1, 4)  # what a fault does to a sample; 0: nothing


class SensorModel(NamedTuple):
    """What does not change: see hertzloop.sensors.acquisition.SensorSpec for the meaning."""

    of_state: int
    every_steps: int
    filter_gain: float  # 1 - exp(-2 pi f_c h); 1 without a filter
    resonant: bool  # a second-order response, exact for an input held over a step
    own_00: float  # what a step makes of output less input and rate over w, without more input
    own_01: float
    own_10: float
    own_11: float
    coupled: bool  # a first-order high-pass
    coupling_gain: float  # 1 - exp(-2 pi f_ac h)
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


@kernel(inline=True, borrowed=True)
def quantise(value, scale, offset, first_code, last_code):
    """Nearest code of a mid-tread converter, ties upwards, clipped to its codes."""
    code = math.floor((value - offset) / scale + 0.5)
    return min(max(code, first_code), last_code)


@kernel(inline=True, borrowed=True)
def follow(model, state, value):
    """Filters, stepped at every simulation step: resonance, AC coupling, one-pole low-pass. All
    start at rest at their first input.

    Without a filter the value itself: adding the difference would round it.
    """
    if model.resonant:
        if state[STARTED] == 0.0:
            state[RESONANT] = value
        else:
            off, rate = state[RESONANT] - value, state[RESONANT_RATE]
            state[RESONANT] = value + model.own_00 * off + model.own_01 * rate
            state[RESONANT_RATE] = model.own_10 * off + model.own_11 * rate
        value = state[RESONANT]
    if model.coupled:
        if state[STARTED] == 0.0:
            state[COUPLED] = value
        else:
            state[COUPLED] += model.coupling_gain * (value - state[COUPLED])
        value -= state[COUPLED]
    if state[STARTED] == 0.0 or model.filter_gain == 1.0:
        state[STARTED] = 1.0
        state[FILTERED] = value
    else:
        state[FILTERED] += model.filter_gain * (value - state[FILTERED])


@kernel(inline=True, borrowed=True)
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
