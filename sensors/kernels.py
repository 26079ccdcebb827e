"""Compiled kernels of the data acquisition."""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel

# Indices into the state. LAST: of a channel with a fault. From OF_SECTIONS on, three numbers for
# each filter: output less input, rate over w, and its last input.
FILTERED, STARTED, LAST, OF_SECTIONS = range(4)
# A section: what a step makes of output less input and of rate over w, by rows; what a rise of the
# input by one adds to both; 1 of a low-pass, 0 of a high-pass.
OWN_00, OWN_01, OWN_10, OWN_11, RAMP_0, RAMP_1, PASSES = range(7)
HELD, ADDED, LIMITED = range(1, 4)  # what a fault does to a sample; 0: nothing


class SensorModel(NamedTuple):
    """What does not change: see hertzloop.sensors.acquisition.SensorSpec for the meaning."""

    of_state: int
    every_steps: int
    sections: np.ndarray  # one row a filter, of the seven columns above
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
    # What `least_sample` needs: see hertzloop.sensors.acquisition.LeastSample.
    gap_share: float
    settling_steps: int
    largest_noise: float
    fault_kind: int
    fault_end: int


@kernel(part=True)
def quantise(value, scale, offset, first_code, last_code):
    """Nearest code of a converter, ties upwards, clipped to its codes."""
    code = math.floor((value - offset) / scale + 0.5)
    return min(max(code, first_code), last_code)


@kernel(inline=True)
def follow(model, state, value):
    """Filters, stepped at every simulation step, and each exact for an input that is linear over a
    step. All start at rest at their first input.

    A low-pass returns its input and a difference, so that without change it returns the input.
    """
    sections = model.sections
    for i in range(sections.shape[0]):
        at = OF_SECTIONS + 3 * i
        off, rate = state[at], state[at + 1]
        rise = value - state[at + 2] if state[STARTED] != 0.0 else 0.0
        state[at + 2] = value
        state[at] = (
            sections[i, OWN_00] * off + sections[i, OWN_01] * rate + sections[i, RAMP_0] * rise
        )
        state[at + 1] = (
            sections[i, OWN_10] * off + sections[i, OWN_11] * rate + sections[i, RAMP_1] * rise
        )
        value = value + state[at] if sections[i, PASSES] == 1.0 else 0.0 - state[at]
    state[STARTED] = 1.0
    state[FILTERED] = value


@kernel(part=True)
def _faulty(model, state, kind, value):
    """Value that a fault of this kind makes of a value; `LAST` is the value before it."""
    if kind == HELD:
        return state[LAST]
    if kind == ADDED:
        return value + model.fault_size
    if kind == LIMITED:
        return min(max(value, -abs(model.fault_size)), abs(model.fault_size))
    return value


@kernel(inline=True)
def sample(model, state, index):
    """Convert the filtered value: code (0 if ideal), value as read, 1 if clipped.

    The first sample has no reading before it that a fault could repeat: it reads its own value.
    """
    value = state[FILTERED]
    if model.noise.size > 0:
        value += model.noise[index]
    if model.fault.size > 0:
        kind = model.fault[index]
        if kind != HELD or index > 0:
            value = _faulty(model, state, kind, value)
        state[LAST] = value
    return _convert(model, value)


@kernel(part=True)
def _convert(model, value):
    """Range and converter: code (0 if ideal), value as read, 1 if clipped."""
    clipped = 0
    if model.limited:
        if value < model.low or value > model.high:
            clipped = 1
        value = min(max(value, model.low), model.high)
    if model.ideal:
        return 0, value, clipped
    code = quantise(value, model.scale, model.offset, model.first_code, model.last_code)
    return code, model.offset + model.scale * code, clipped


@kernel(inline=True)
def least_sample(model, state, index, least, quiet_steps):
    """Return a value that no sample from number `index`, 1 or more, on can be below; -inf where
    none is known.

    `least`: lowest value of the quantity from now on. For `quiet_steps` it was, and as long as it
    is asked for it will be, at least half of its highest value since then.
    """
    if not least > 0.0 or quiet_steps < model.settling_steps or model.gap_share == -math.inf:
        return -math.inf
    value = min(model.gap_share * least, state[FILTERED]) - model.largest_noise
    if model.fault_kind != 0 and index < model.fault_end:
        value = min(value, _faulty(model, state, model.fault_kind, value))
    return _convert(model, value)[1]
