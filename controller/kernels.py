"""Compiled kernels of the controller: laws, and the line from command to actuator force.

A law turns sample i (taken at step i n) into a command; the line turns commands into one
actuator force a step. With latency L the command of sample i acts from step i n + 1 + L.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

# Laws.
OFF, SLOPE_THRESHOLD, PROFILE = range(3)
# Modes of a law.
IDLE, WATCHING, ACTING, SPENT = range(4)
# Indices into the law's counts.
MODE, SAMPLES, CONTACT_START, DELAY, TRIGGER, COMMANDED, WAS_IN_CONTACT = range(7)
LAW_COUNTS = 7
# Indices into the line's counts and values.
EMITTED, LAST_ACTING, LAST_PUSHING = range(3)  # steps; the last: of a force not zero
LINE_COUNTS = 3
HELD, OUTPUT = range(2)


class LawModel(NamedTuple):
    """Parameters of a law; `contact_level` is the sampled value at and below which the
    sphere counts as in contact, `profile` holds one force (N) a sample. A law looks
    `lead_samples` ahead: it commands what is due that much later."""

    law: int
    contact_level: float
    sample_s: float
    kappa: float
    v_thr_m_s: float
    stiffness: float
    profile: np.ndarray
    lead_samples: int


class LawState(NamedTuple):
    """Mode and counters by the indices above, and all samples so far."""

    counts: np.ndarray
    history: np.ndarray


class LineModel(NamedTuple):
    """Latency line and converter; arrays hold one value a sample or are empty."""

    every_steps: int
    latency_steps: int
    jitter_steps: np.ndarray
    dropped: np.ndarray
    ideal: bool
    limited: bool
    full_scale_n: float
    lsb_n: float
    last_code: int
    slew_n: float  # largest change in a step; inf without a limit


class LineState(NamedTuple):
    """`scheduled[j]`: command that starts to act at step j, NaN where none does."""

    scheduled: np.ndarray
    counts: np.ndarray
    values: np.ndarray


@njit(cache=True, error_model="numpy", forceinline=True)
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


@njit(cache=True, error_model="numpy", forceinline=True)
def _slope_command(model, history, index, delay):
    """kappa s p^(3/2) of the penetration `delay` samples ago, less the lead; whether it was
    in contact."""
    earlier = history[index - max(delay - model.lead_samples, 0)]
    if earlier > model.contact_level:
        return 0.0, False
    p = max(-earlier, 0.0)
    return model.kappa * model.stiffness * p * math.sqrt(p), True


@njit(cache=True, error_model="numpy", forceinline=True)
def _profile_command(model, start, index):
    """Profile value `index - start` samples after the trigger; whether it goes on."""
    at = index - start + model.lead_samples
    if at >= model.profile.size:
        return 0.0, False
    return model.profile[at], True


@njit(cache=True, error_model="numpy", forceinline=True)
def take_sample(model, state, value):
    """Feed the next sample to the law; returns its command (N)."""
    counts, history = state.counts, state.history
    index = counts[SAMPLES]
    history[index] = value
    counts[SAMPLES] = index + 1
    in_contact = value <= model.contact_level
    began = in_contact and counts[WAS_IN_CONTACT] == 0
    counts[WAS_IN_CONTACT] = 1 if in_contact else 0
    if began:
        counts[CONTACT_START] = index
    if model.law == OFF:
        return 0.0
    if counts[MODE] == IDLE and in_contact:
        counts[MODE] = WATCHING
        if model.law == PROFILE:
            counts[MODE] = ACTING
            counts[TRIGGER] = index
    if counts[MODE] == WATCHING:
        if not in_contact:
            counts[MODE] = IDLE
        elif index > 0 and (value - history[index - 1]) / model.sample_s > model.v_thr_m_s:
            counts[MODE] = ACTING
            counts[DELAY] = index - counts[CONTACT_START]
    if counts[MODE] == ACTING:
        if model.law == PROFILE:
            command, goes_on = _profile_command(model, counts[TRIGGER], index)
            if not goes_on:
                counts[MODE] = SPENT if in_contact else IDLE
        else:
            command, goes_on = _slope_command(model, history, index, counts[DELAY])
            if not goes_on:
                counts[MODE] = WATCHING if in_contact else IDLE
        return command
    if counts[MODE] == SPENT and not in_contact:
        counts[MODE] = IDLE
    return 0.0


@njit(cache=True, error_model="numpy")
def known_ahead(model, state):
    """Number of samples to come whose command no longer depends on them."""
    counts = state.counts
    if counts[MODE] != ACTING:
        return 0
    last = counts[SAMPLES] - 1
    if model.law == PROFILE:
        return max(counts[TRIGGER] + model.profile.size - model.lead_samples - last, 0)
    back = max(counts[DELAY] - model.lead_samples, 0)
    for ahead in range(1, back + 1):
        if state.history[last + ahead - back] > model.contact_level:
            return ahead
    return back


@njit(cache=True, error_model="numpy")
def _command_ahead(model, state, index):
    """Command of the future sample `index`, which `known_ahead` has vouched for."""
    if model.law == PROFILE:
        return _profile_command(model, state.counts[TRIGGER], index)[0]
    return _slope_command(model, state.history, index, state.counts[DELAY])[0]


@njit(cache=True, error_model="numpy", forceinline=True)
def _schedule(line, state, index, command):
    """Enter the command of sample `index` into the line."""
    if line.dropped.size > 0 and line.dropped[index]:
        return
    acts = index * line.every_steps + 1 + line.latency_steps
    if line.jitter_steps.size > 0:
        acts += line.jitter_steps[index]
    acts = max(acts, state.counts[LAST_ACTING])  # the line keeps the order of its commands
    state.counts[LAST_ACTING] = acts
    force = convert_force(line, command)
    if force != 0.0:
        state.counts[LAST_PUSHING] = acts
    if acts < state.scheduled.size:
        state.scheduled[acts] = force


@njit(cache=True, error_model="numpy", forceinline=True)
def _emit(line, state, end, forces):
    """Write the actuator force of all steps before `end` that are still open."""
    values, counts = state.values, state.counts
    end = min(end, forces.size)
    for j in range(counts[EMITTED], end):
        if not math.isnan(state.scheduled[j]):
            values[HELD] = state.scheduled[j]
        change = values[HELD] - values[OUTPUT]
        if abs(change) <= line.slew_n:
            values[OUTPUT] = values[HELD]
        else:
            values[OUTPUT] += line.slew_n if change > 0.0 else -line.slew_n
        forces[j] = values[OUTPUT]
    counts[EMITTED] = max(counts[EMITTED], end)


@njit(cache=True, error_model="numpy", forceinline=True)
def control_sample(law, law_state, line, line_state, value, forces):
    """One sample through law and line; `forces` is final up to the line's EMITTED step."""
    index = law_state.counts[SAMPLES]
    command = take_sample(law, law_state, value)
    if index >= law_state.counts[COMMANDED]:
        _schedule(line, line_state, index, command)
        law_state.counts[COMMANDED] = index + 1
    _emit(line, line_state, (index + 1) * line.every_steps + 1 + line.latency_steps, forces)


@njit(cache=True, error_model="numpy")
def control_block(law, law_state, line, line_state, values, forces, modes, delays):
    """Samples of a block through law and line; writes mode and delay after each."""
    for i in range(values.size):
        control_sample(law, law_state, line, line_state, values[i], forces)
        modes[i] = law_state.counts[MODE]
        delays[i] = law_state.counts[DELAY]


@njit(cache=True, error_model="numpy")
def grant_ahead(law, law_state, line, line_state, forces):
    """Extend the forces by what the law already knows about samples to come."""
    index = law_state.counts[SAMPLES]
    known = min(known_ahead(law, law_state), law_state.history.size - index)
    for future in range(max(index, law_state.counts[COMMANDED]), index + known):
        _schedule(line, line_state, future, _command_ahead(law, law_state, future))
        law_state.counts[COMMANDED] = future + 1
    if known > 0:
        end = (index + known) * line.every_steps + 1 + line.latency_steps
        _emit(line, line_state, end, forces)


@njit(cache=True, error_model="numpy")
def promises_zero(law, law_state, line_state):
    """Whether the force stays zero for as long as no further sample is in contact."""
    idle = law.law == OFF or law_state.counts[MODE] == IDLE
    quiet = line_state.values[HELD] == 0.0 and line_state.values[OUTPUT] == 0.0
    return idle and quiet and line_state.counts[LAST_PUSHING] < line_state.counts[EMITTED]
