"""Compiled kernels of the controller: from a law's commands to one actuator force a step.

With latency L the command of sample i, taken at step i n, acts from step i n + 1 + L. Latency is
applied here alone, by `_schedule`: a force is sent with the step in which it acts. A controller
that is not ours applies its own; a paced run may be late on top.
"""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel
from hertzloop.controller import law_kernels as laws

# Indices into the counts and values of a signal path.
# Steps, the third of a force not zero; SCHEDULED: samples whose command has entered it.
EMITTED, LAST_ACTING, LAST_PUSHING, SCHEDULED = range(4)
SIGNAL_PATH_COUNTS = 4
HELD, OUTPUT = range(2)


class SignalPathModel(NamedTuple):
    """Latency and converter of a signal path; arrays hold one value a sample or are empty."""

    every_steps: int
    latency_steps: int
    added_steps: np.ndarray
    dropped: np.ndarray
    ideal: bool
    limited: bool
    full_scale_n: float
    lsb_n: float
    last_code: int
    slew_n: float  # largest change in a step; inf without a limit


class SignalPathState(NamedTuple):
    """`scheduled[j]`: command that starts to act at step j, NaN where none does."""

    scheduled: np.ndarray
    counts: np.ndarray
    values: np.ndarray


@kernel(inline=True)
def convert_force(model, force):
    """Force that the actuator's converter puts out: clipped, on the nearest level.

    Levels are whole multiples of the step, so that no force stays no force.
    """
    if model.limited:
        force = min(max(force, -model.full_scale_n), model.full_scale_n)
    if model.ideal:
        return force
    code = math.floor(force / model.lsb_n + 0.5)
    code = min(max(code, -model.last_code), model.last_code)
    return code * model.lsb_n


@kernel(part=True)
def _schedule(path, state, index, command):
    """Enter the command of sample `index`, the next one, into the signal path."""
    state.counts[SCHEDULED] = index + 1
    if path.dropped.size > 0 and path.dropped[index]:
        return
    acts = index * path.every_steps + 1 + path.latency_steps
    if path.added_steps.size > 0:
        acts += path.added_steps[index]
    acts = max(acts, state.counts[LAST_ACTING])  # it keeps the order of its commands
    state.counts[LAST_ACTING] = acts
    force = convert_force(path, command)
    if force != 0.0:
        state.counts[LAST_PUSHING] = acts
    if acts < state.scheduled.size:
        state.scheduled[acts] = force


@kernel(part=True)
def _emit(path, state, end, forces):
    """Write the actuator force of all steps before `end` that are still open."""
    values, counts = state.values, state.counts
    end = min(end, forces.size)
    for j in range(counts[EMITTED], end):
        if not math.isnan(state.scheduled[j]):
            values[HELD] = state.scheduled[j]
        change = values[HELD] - values[OUTPUT]
        if abs(change) <= path.slew_n:
            values[OUTPUT] = values[HELD]
        else:
            values[OUTPUT] += path.slew_n if change > 0.0 else -path.slew_n
        forces[j] = values[OUTPUT]
    counts[EMITTED] = max(counts[EMITTED], end)


@kernel(part=True)
def control_sample(law, law_state, path, path_state, value, forces):
    """One sample through law and signal path; `forces` is final up to its EMITTED step."""
    index = law_state.counts[laws.SAMPLES]
    command = laws.command_for_sample(law, law_state, value)
    if index >= path_state.counts[SCHEDULED]:
        _schedule(path, path_state, index, command)
    _emit(path, path_state, (index + 1) * path.every_steps + 1 + path.latency_steps, forces)


@kernel
def schedule_ahead(law_state, path, path_state, forces):
    """Extend the forces by the commands that the law has given for samples to come."""
    commanded = law_state.counts[laws.COMMANDED]
    if commanded > law_state.counts[laws.SAMPLES]:
        for future in range(path_state.counts[SCHEDULED], commanded):
            _schedule(path, path_state, future, law_state.ahead[future])
        _emit(path, path_state, commanded * path.every_steps + 1 + path.latency_steps, forces)


@kernel
def is_quiet(path_state):
    """Whether no force acts, and none is on its way."""
    quiet = path_state.values[HELD] == 0.0 and path_state.values[OUTPUT] == 0.0
    return quiet and path_state.counts[LAST_PUSHING] < path_state.counts[EMITTED]
