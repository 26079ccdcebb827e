"""Compiled kernels that join plant, sensor and controller.

`advance` runs the plant process's side up to what it was granted; `closed_loop` runs all
three in one call. Both take the same steps through the same kernels in the same order, so
the samples are the same bits. Nothing allocates: without reference counts (`_nrt=False`).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from controller import kernels as ck
from controller import law_kernels as laws
from plant import kernels as pk
from plant.schemes import step as step_plant
from sensors import kernels as sk

# Columns of a truth window, in the order of the message's fields.
TRUTH_COLUMNS = 8  # xi, xi_s, xi_p, v_p, F_c, F_a, xi_a, F_c1
# Indices into Window.counts.
TRUTH_FIRST, TRUTH_END, SAMPLES_FIRST, SAMPLES_END, OBSERVED = range(5)
WINDOW_COUNTS = 5
# Indices into Grant arrays.
GRANTED_END, PROMISED, BROKEN_AT = range(3)
GRANT_COUNTS = 3


class Window(NamedTuple):
    """Rows of truth and samples that were not sent yet, by position since *_FIRST."""

    truth: np.ndarray  # (TRUTH_COLUMNS, steps)
    codes: np.ndarray
    values: np.ndarray
    clipped: np.ndarray
    counts: np.ndarray


class Grant(NamedTuple):
    """What the controller allowed: forces known before step GRANTED_END, and, while
    PROMISED is 1, zero for as long as samples stay above `level`. BROKEN_AT: number of
    samples taken when a sample last fell to the level."""

    counts: np.ndarray
    level: np.ndarray
    lead_steps: int  # the force of a sample at step k acts from step k + lead_steps on


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)
def _observe(plant_state, sensor, sensor_state, window):
    """Let the sensor see the present step, once; returns whether it took a sample."""
    counts = window.counts
    step = plant_state.counts[pk.STEP]
    if counts[OBSERVED] > step:
        return False
    counts[OBSERVED] = step + 1
    body = plant_state.body
    if sensor.quantity == sk.XI:
        value = body[pk.XI]
    elif sensor.quantity == sk.PLATE_VELOCITY:
        value = body[pk.V_P]
    elif sensor.quantity == sk.PLATE_ACCELERATION:
        value = body[pk.A_P]
    else:
        value = body[pk.F_C]
    sk.follow(sensor, sensor_state, value)
    if step % sensor.every_steps != 0:
        return False
    index = counts[SAMPLES_END]
    at = index - counts[SAMPLES_FIRST]
    code, value, clipped = sk.sample(sensor, sensor_state, index)
    window.codes[at] = code
    window.values[at] = value
    window.clipped[at] = clipped
    counts[SAMPLES_END] = index + 1
    return True


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)
def _step_and_record(plant, plant_state, f_a, window):
    """One plant step; writes its row of truth."""
    row = window.counts[TRUTH_END] - window.counts[TRUTH_FIRST]
    body, truth = plant_state.body, window.truth
    truth[0, row] = body[pk.XI]
    truth[1, row] = body[pk.XI_S]
    truth[2, row] = body[pk.XI_P]
    truth[6, row] = body[pk.XI_A]
    truth[4, row] = step_plant(plant, plant_state, f_a)
    truth[3, row] = body[pk.V_P_OF_STEP]
    truth[5, row] = f_a
    truth[7, row] = body[pk.F_C1]
    window.counts[TRUTH_END] += 1


@njit(cache=True, error_model="numpy", _nrt=False)
def plant_alone(plant, plant_state, forces, window):
    """The plant under given actuator forces, one a step, without sensor and controller."""
    for i in range(forces.size):
        _step_and_record(plant, plant_state, forces[i], window)


@njit(cache=True, error_model="numpy", _nrt=False)
def advance(plant, plant_state, sensor, sensor_state, forces, window, grant, end):
    """Run the plant to step `end` or as far as forces are known; True if it has to wait."""
    while plant_state.counts[pk.STEP] < end:
        step = plant_state.counts[pk.STEP]
        if _observe(plant_state, sensor, sensor_state, window):
            at = window.counts[SAMPLES_END] - 1 - window.counts[SAMPLES_FIRST]
            if window.values[at] <= grant.level[0]:
                grant.counts[BROKEN_AT] = window.counts[SAMPLES_END]
                if grant.counts[PROMISED] == 1:
                    # All samples before this one were above the level: forces are known to
                    # be zero until this one's own force acts.
                    known = step + grant.lead_steps
                    grant.counts[PROMISED] = 0
                    grant.counts[GRANTED_END] = max(grant.counts[GRANTED_END], known)
        if grant.counts[PROMISED] == 0 and step >= grant.counts[GRANTED_END]:
            return True
        _step_and_record(plant, plant_state, forces[step], window)
    return False


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)
def _last_push(forces, step, end):
    """Last step after `step` and before `end` with a force; `step` without."""
    for j in range(min(end, forces.size) - 1, step, -1):
        if forces[j] != 0.0:
            return j
    return step


@njit(cache=True, error_model="numpy", _nrt=False)
def closed_loop(
    plant, plant_state, sensor, sensor_state, law, law_state, line, line_state,
    forces, window, modes, delays, end, quiet_steps,
):  # fmt: skip
    """Plant, sensor and controller together up to step `end`, or, if `quiet_steps` is not
    negative, until after a contact nothing has touched or pushed for so long and no force is left
    to come; returns whether that was so."""
    touched = False
    last = 0
    while plant_state.counts[pk.STEP] < end:
        if _observe(plant_state, sensor, sensor_state, window):
            at = window.counts[SAMPLES_END] - 1 - window.counts[SAMPLES_FIRST]
            ck.control_sample(law, law_state, line, line_state, window.values[at], forces)
            modes[at] = law_state.counts[laws.MODE]
            delays[at] = law_state.counts[laws.DELAY]
        step = plant_state.counts[pk.STEP]
        _step_and_record(plant, plant_state, forces[step], window)
        if plant_state.body[pk.F_C] != 0.0:
            touched = True
            last = step
        elif touched and forces[step] != 0.0:
            last = step
        elif touched and 0 <= quiet_steps <= step - last:
            if ck.promises_zero(law, law_state, line_state):
                # The promise counts from the emitted forces on, which latency puts ahead.
                last = _last_push(forces, step, line_state.counts[ck.EMITTED])
                if last == step:
                    return True
    return False
