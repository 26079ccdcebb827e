"""Compiled kernels of the force laws: one sample in, one command out.

A law turns sample i (taken at step i n) into a command (N), the actuator's force up on the plate.
The threshold laws answer the penetration with kappa s p^(3/2) of the penetration `delay` samples
earlier, from the moment on at which its slope rises above v_thr; `PREDICTED` does so for the
penetration that a local model expects when the force will act; the feedback laws multiply.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

# Laws.
OFF, SLOPE_THRESHOLD, PROFILE, PREDICTED, FEEDBACK, INTEGRAL_FEEDBACK = range(6)
# Modes of a law.
IDLE, WATCHING, ACTING, SPENT = range(4)
# Indices into the law's counts. LEFT: sample at which the last contact was left.
MODE, SAMPLES, CONTACT_START, DELAY, TRIGGER, COMMANDED, WAS_IN_CONTACT, LEFT = range(8)
LAW_COUNTS = 8
_LEAST_PARTS, _MOST_PARTS = 16, 512  # of the time over which the local model is integrated


class LawModel(NamedTuple):
    """Parameters of a law; `contact_level` is the sampled value at and below which the
    sphere counts as in contact, `profile` holds one force (N) a sample. A law looks
    `lead_samples` ahead: it commands what is due that much later. `slope_weights`: of the last
    samples, 1/s. Below `watch_level` the law `PREDICTED` watches. `gain`: command per sampled
    value, or per its integral, which keeps the share `keep` from sample to sample;
    values up to `dead_zone` count as zero; `fade_samples` below 0: the force does not fade."""

    law: int
    contact_level: float
    watch_level: float
    sample_s: float
    kappa: float
    v_thr_m_s: float
    stiffness: float
    mass_kg: float
    impedance_n_s_m: float
    profile: np.ndarray
    slope_weights: np.ndarray
    lead_samples: int
    fade_samples: int
    gain: float
    keep: float
    dead_zone: float


class LawState(NamedTuple):
    """Mode and counters by the indices above, all samples so far, the integral of feedback."""

    counts: np.ndarray
    history: np.ndarray
    integral: np.ndarray  # (1,)


@njit(cache=True, error_model="numpy", forceinline=True)
def _slope(model, history, index):
    """Slope at the middle of the window that ends at sample `index`."""
    weights = model.slope_weights
    if weights.size == 2:
        return (history[index] - history[index - 1]) / model.sample_s
    first = index + 1 - weights.size
    slope = 0.0
    for i in range(weights.size):
        slope += weights[i] * history[first + i]
    return slope


@njit(cache=True, error_model="numpy", forceinline=True)
def _hertz_command(model, xi):
    p = max(-xi, 0.0)
    return model.kappa * model.stiffness * p * math.sqrt(p)


@njit(cache=True, error_model="numpy", forceinline=True)
def _faded(model, counts, index):
    """Share of the command that is left `index - LEFT + 1` samples after the contact's end."""
    if model.fade_samples < 0 or counts[WAS_IN_CONTACT] == 1:
        return 1.0
    after = index - counts[LEFT] + 1
    if after > model.fade_samples:
        return 0.0
    return 0.5 + 0.5 * math.cos(math.pi * after / (model.fade_samples + 1))


@njit(cache=True, error_model="numpy", forceinline=True)
def _slope_command(model, history, index, delay):
    """Command from the penetration `delay` samples ago, less the lead; whether it goes on: for
    as long as that was in contact, or, with a prediction, not yet on its way out."""
    at = index - max(delay - model.lead_samples, 0)
    earlier = history[at]
    if earlier > model.contact_level:
        approaches = model.law == PREDICTED and at > 0 and earlier < history[at - 1]
        return 0.0, approaches
    return _hertz_command(model, earlier), True


@njit(cache=True, error_model="numpy", forceinline=True)
def _acceleration(model, xi, slope):
    """xi'' of a sphere against an infinite plate, F/m + F'/Z (Zener 1941); 0 in flight."""
    if xi >= model.contact_level:
        return 0.0
    root = math.sqrt(max(-xi, 0.0))
    force = -model.stiffness * xi * root
    return force / model.mass_kg - 1.5 * model.stiffness * root * slope / model.impedance_n_s_m


@njit(cache=True, error_model="numpy")
def look_ahead(model, history, index, ahead):
    """What the local model expects `ahead` samples after sample `index`.

    Integrated from the middle of the slope's window (midpoint rule). Returns xi (m), its slope
    (m/s), and, in samples after `index` or infinite: when contact begins, when the slope
    first passes the threshold in contact.
    """
    width = model.slope_weights.size
    xi = 0.0
    for i in range(width):
        xi += history[index - i]
    xi /= width
    slope = _slope(model, history, index)
    back = 0.5 * (width - 1)
    parts = min(max(int(back + ahead) + 1, _LEAST_PARTS), _MOST_PARTS)
    dt = (back + ahead) * model.sample_s / parts
    touches, crosses = math.inf, math.inf
    for i in range(parts):
        half = slope + 0.5 * dt * _acceleration(model, xi, slope)
        to = xi + dt * half
        new = slope + dt * _acceleration(model, xi + 0.5 * dt * slope, half)
        if touches == math.inf and to <= model.contact_level:
            share = (xi - model.contact_level) / (xi - to) if xi > model.contact_level else 0.0
            touches = (i + share) * dt / model.sample_s - back
        if crosses == math.inf and to <= model.contact_level and new > model.v_thr_m_s:
            share = (model.v_thr_m_s - slope) / (new - slope) if slope < model.v_thr_m_s else 0.0
            crosses = (i + share) * dt / model.sample_s - back
        xi, slope = to, new
    return xi, slope, touches, crosses


@njit(cache=True, error_model="numpy", forceinline=True)
def _predicted_command(model, history, index, delay):
    """Command for a force that acts `lead_samples` later, and whether it goes on."""
    if delay >= model.lead_samples:
        return _slope_command(model, history, index, delay)
    xi, slope, _, _ = look_ahead(model, history, index, model.lead_samples - delay)
    if xi > model.contact_level:
        return 0.0, slope < 0.0
    return _hertz_command(model, xi), True


@njit(cache=True, error_model="numpy", forceinline=True)
def _expects_threshold(model, state, index, in_contact):
    """Whether the slope will have passed the threshold when the force acts; latches the delay."""
    if index + 1 < model.slope_weights.size:
        return False
    _, _, touches, crosses = look_ahead(model, state.history, index, model.lead_samples)
    if crosses == math.inf:
        return False
    since = index - state.counts[CONTACT_START] if in_contact else -touches
    state.counts[DELAY] = max(math.ceil(since + max(crosses, -since)), 0)
    return True


@njit(cache=True, error_model="numpy", forceinline=True)
def _profile_command(model, start, index):
    """Profile value `index - start` samples after the trigger; whether it goes on."""
    at = index - start + model.lead_samples
    if at >= model.profile.size:
        return 0.0, False
    return model.profile[at], True


@njit(cache=True, error_model="numpy", forceinline=True)
def _feedback(model, state, value):
    """Command in proportion to the value or its integral; ACTING from the first one on."""
    if abs(value) <= model.dead_zone:
        value = 0.0
    if model.law == INTEGRAL_FEEDBACK:
        state.integral[0] = model.keep * (state.integral[0] + model.sample_s * value)
        value = state.integral[0]
    if value != 0.0:
        state.counts[MODE] = ACTING
    return model.gain * value


@njit(cache=True, error_model="numpy", forceinline=True)
def take_sample(model, state, value):
    """Feed the next sample to the law; returns its command (N)."""
    counts, history = state.counts, state.history
    index = counts[SAMPLES]
    history[index] = value
    counts[SAMPLES] = index + 1
    if model.law == OFF:
        return 0.0
    if model.law >= FEEDBACK:
        return _feedback(model, state, value)
    in_contact = value <= model.contact_level
    if in_contact and counts[WAS_IN_CONTACT] == 0:
        counts[CONTACT_START] = index
    if not in_contact and counts[WAS_IN_CONTACT] == 1:
        counts[LEFT] = index
    counts[WAS_IN_CONTACT] = 1 if in_contact else 0
    near = in_contact or (model.law == PREDICTED and value <= model.watch_level)
    if counts[MODE] == IDLE and near:
        counts[MODE] = WATCHING
        if model.law == PROFILE:
            counts[MODE] = ACTING
            counts[TRIGGER] = index
    if counts[MODE] == WATCHING:
        if not near:
            counts[MODE] = IDLE
        elif model.law == PREDICTED:
            if _expects_threshold(model, state, index, in_contact):
                counts[MODE] = ACTING
        elif (
            index + 1 >= model.slope_weights.size
            and _slope(model, history, index) > model.v_thr_m_s
        ):
            counts[MODE] = ACTING
            counts[DELAY] = index - counts[CONTACT_START]
    if counts[MODE] == ACTING:
        if model.law == PROFILE:
            command, goes_on = _profile_command(model, counts[TRIGGER], index)
            if not goes_on:
                counts[MODE] = SPENT if in_contact else IDLE
        elif model.law == PREDICTED:
            command, goes_on = _predicted_command(model, history, index, counts[DELAY])
            if not goes_on:
                counts[MODE] = SPENT if in_contact else IDLE
        else:
            command, goes_on = _slope_command(model, history, index, counts[DELAY])
            share = _faded(model, counts, index)
            command *= share
            if not goes_on or share == 0.0:
                counts[MODE] = WATCHING if in_contact else IDLE
        return command
    if counts[MODE] == SPENT and not in_contact:
        counts[MODE] = IDLE
    return 0.0


@njit(cache=True, error_model="numpy")
def known_ahead(model, state):
    """Number of samples to come whose command no longer depends on them."""
    counts = state.counts
    if counts[MODE] != ACTING or model.law >= FEEDBACK or model.fade_samples >= 0:
        return 0
    last = counts[SAMPLES] - 1
    if model.law == PROFILE:
        return max(counts[TRIGGER] + model.profile.size - model.lead_samples - last, 0)
    back = max(counts[DELAY] - model.lead_samples, 0)
    for ahead in range(1, back + 1):
        if not _slope_command(model, state.history, last + ahead, counts[DELAY])[1]:
            return ahead
    return back


@njit(cache=True, error_model="numpy")
def command_ahead(model, state, index):
    """Command of the future sample `index`, which `known_ahead` has vouched for."""
    if model.law == PROFILE:
        return _profile_command(model, state.counts[TRIGGER], index)[0]
    return _slope_command(model, state.history, index, state.counts[DELAY])[0]
