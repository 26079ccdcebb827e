"""Compiled kernels that join plant, sensor and controller.

`closed_loop` runs all three in one call. Between processes, `advance` runs the plant as far as
forces are known, and `answer_samples` runs the controller; over shared memory the two exchange
samples and forces directly. All of them take the same steps through the same kernels in the same
order, so the samples are the same bits. Nothing allocates.
"""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.bus import lane_kernels
from hertzloop.bus.lane_kernels import FORCES_PUT, OPEN, SAMPLES_PUT, now_ns
from hertzloop.common.jit import kernel
from hertzloop.controller import kernels as controller_kernels
from hertzloop.controller import law_kernels as laws
from hertzloop.controller.kernels import EMITTED
from hertzloop.plant.metrics import impact_kernels
from hertzloop.plant.metrics.impact_kernels import BACK, OVER
from hertzloop.plant.state_kernels import ACTUATOR_F, ACTUATOR_RATE, F_A, F_C, STEP, XI
from hertzloop.plant.time_series import record_step
from hertzloop.sensors import kernels as sensor_kernels

# Indices into Window.counts.
TRUTH_FIRST, TRUTH_END, SAMPLES_FIRST, SAMPLES_END, OBSERVED = range(5)
WINDOW_COUNTS = 5
# Indices into the arrays of TimeGrant.
GRANTED_END, PROMISED, BROKEN_AT, FORCES_END, SEEN, EXCHANGES = range(6)
GRANT_COUNTS = 6
# Status with which `advance`, `await_answers` and `answer_samples` end: as far as asked, a force is
# missing, the lane is silent, or a fault in the lane.
REACHED, MUST_WAIT, SILENT, GAP, WRONG_COUNT, BEYOND_END, NO_NUMBER, BROKEN_PROMISE = range(8)
_AT_ONCE = 64  # samples that are answered together, if so many are there
_LOOK_EVERY = 8  # exchanges between two looks at the clock


class Window(NamedTuple):
    """Time series and samples that were not sent yet. Position 0 is step or sample *_FIRST."""

    truth: np.ndarray  # (columns of hertzloop.plant.time_series, steps)
    codes: np.ndarray
    values: np.ndarray
    clipped: np.ndarray
    counts: np.ndarray


class TimeGrant(NamedTuple):
    """Up to which step the plant may run without waiting for the controller.

    Forces are known before step GRANTED_END. While PROMISED is 1, they stay zero as long as samples
    stay above `level`. BROKEN_AT: samples taken when one last fell to the level. FORCES_END: steps
    whose force was received, without promised zeros. SEEN: samples answered. EXCHANGES: how often
    the plant waited for a force in shared memory.
    """

    counts: np.ndarray
    level: np.ndarray
    lookahead_steps: int  # the force of a sample at step k acts from step k + lookahead_steps on


@kernel(part=True)
def observe(plant_state, sensor, sensor_state, window):
    """Let the sensor follow the present step, once. Return whether it took a sample."""
    counts = window.counts
    step = plant_state.counts[STEP]
    if counts[OBSERVED] > step:
        return False
    counts[OBSERVED] = step + 1
    sensor_kernels.follow(sensor, sensor_state, plant_state.body[sensor.of_state])
    if step % sensor.every_steps != 0:
        return False
    index = counts[SAMPLES_END]
    at = index - counts[SAMPLES_FIRST]
    code, value, clipped = sensor_kernels.sample(sensor, sensor_state, index)
    window.codes[at] = code
    window.values[at] = value
    window.clipped[at] = clipped
    counts[SAMPLES_END] = index + 1
    return True


@kernel(copied=True)
def step_and_record(plant, plant_state, command, window):
    """Run one plant step under a commanded force, and write its time series into the window."""
    row = window.counts[TRUTH_END] - window.counts[TRUTH_FIRST]
    record_step(plant, plant_state, command, window.truth, row)
    window.counts[TRUTH_END] += 1


@kernel(copied=True)
def hold_command(plant, plant_state, sensor, sensor_state, window, command, steps):
    """Run `steps` steps under one command, for an exported plant. The sensor follows every step.

    The window has room for one row; it keeps the last step and the last sample.
    """
    counts = window.counts
    while True:
        if observe(plant_state, sensor, sensor_state, window):
            counts[SAMPLES_FIRST] = counts[SAMPLES_END]
        if steps <= 0:
            break
        steps -= 1
        counts[TRUTH_FIRST] = counts[TRUTH_END]
        step_and_record(plant, plant_state, command, window)


@kernel(part=True)
def update_promise(samples, promises, level, window, grant):
    """Begin, renew or end the promise of zero force, as an answer to `samples` samples says.

    A promise concerns the samples after those answered, and some of them may have been taken. The
    answer counts if none of them can have broken its promise: there is none, or all of them were
    compared with the same level and stayed above it. `level` has no meaning without a promise.
    """
    counts = grant.counts
    if samples == window.counts[SAMPLES_END] or (
        samples >= counts[BROKEN_AT] and (not promises or level == grant.level[0])
    ):
        counts[PROMISED] = promises
        if promises:
            grant.level[0] = level


@kernel(inline=True)
def _accept_record(step, samples, force, level, forces, window, grant):
    """Add one record of an answer.

    `force` is NaN in a record without a force, `level` in one without a promise.
    """
    counts = grant.counts
    if not counts[SEEN] <= samples <= window.counts[SAMPLES_END]:
        return WRONG_COUNT
    if not math.isnan(force):
        at = counts[FORCES_END]
        if at >= forces.size:
            return BEYOND_END
        if math.isinf(force):
            return NO_NUMBER
        if at < step and forces[at] != force:
            return BROKEN_PROMISE
        forces[at] = force
        counts[FORCES_END] = at + 1
        counts[GRANTED_END] = max(counts[GRANTED_END], at + 1)
    if samples == counts[SEEN]:
        return REACHED  # more of this answer follows
    counts[SEEN] = samples
    if level == math.inf:
        return NO_NUMBER
    update_promise(samples, not math.isnan(level), level, window, grant)
    return REACHED


@kernel(part=True)
def receive_record(lane, step, forces, window, grant):
    """Receive the next record of an answer, which has arrived."""
    excess, samples, force, level = lane_kernels.receive_force(lane)
    if excess != 0:
        return GAP
    return _accept_record(step, samples, force, level, forces, window, grant)


@kernel(part=True)
def check_threshold(step, value, window, grant):
    """End the promise of zero force if the sample of `step`, just taken, fell to its level."""
    counts = grant.counts
    if value <= grant.level[0]:
        counts[BROKEN_AT] = window.counts[SAMPLES_END]
        if counts[PROMISED] == 1:
            # All samples before this one were above the level: forces are known to be zero until
            # this one's own force acts.
            counts[PROMISED] = 0
            counts[GRANTED_END] = max(counts[GRANTED_END], step + grant.lookahead_steps)


@kernel
def _wait_for_forces(step, until, forces, window, grant, lane):
    """Wait in the lane until the force of `step` is known and `until` samples are answered."""
    counts = grant.counts
    while counts[SEEN] < until or (counts[PROMISED] == 0 and counts[GRANTED_END] <= step):
        if counts[SEEN] == window.counts[SAMPLES_END]:
            return MUST_WAIT  # all is answered, and no force granted
        if not lane_kernels.wait_for_answer(lane):
            return SILENT
        status = receive_record(lane, step, forces, window, grant)
        if status != REACHED:
            return status
    return REACHED


@kernel
def await_answers(plant_state, forces, window, grant, lane):
    """Wait in the lane until all samples are answered and all forces of past steps are known."""
    step = plant_state.counts[STEP]
    return _wait_for_forces(step - 1, window.counts[SAMPLES_END], forces, window, grant, lane)


@kernel
def advance(plant, plant_state, sensor, sensor_state, forces, commands, window, grant, lane, end):
    """Run the plant to step `end`, or as far as `forces` are known. The plant's side.

    `commands` act: the array `forces`, or the commands of a repeated run. Ends early where
    exchanges are slow.
    """
    counts = grant.counts
    in_lane = lane.own[OPEN] != 0
    began = now_ns() if in_lane else 0
    while plant_state.counts[STEP] < end:
        step = plant_state.counts[STEP]
        if in_lane and window.counts[SAMPLES_END] - counts[SEEN] >= lane.slots:
            status = _wait_for_forces(-1, counts[SEEN] + 1, forces, window, grant, lane)  # for room
            if status != REACHED:
                return status
        if observe(plant_state, sensor, sensor_state, window):
            at = window.counts[SAMPLES_END] - 1 - window.counts[SAMPLES_FIRST]
            if in_lane:
                lane_kernels.put_sample(lane, window.counts[SAMPLES_END] - 1, window.values[at])
            check_threshold(step, window.values[at], window, grant)
        if counts[PROMISED] == 0 and step >= counts[GRANTED_END]:
            if not in_lane:
                return MUST_WAIT
            status = _wait_for_forces(step, 0, forces, window, grant, lane)
            if status != REACHED:
                return status
            counts[EXCHANGES] += 1
            if counts[EXCHANGES] % _LOOK_EVERY == 0 and now_ns() - began > lane.wait_ns:
                end = step + 1  # slow exchanges, none of which takes as long as a silence
        step_and_record(plant, plant_state, commands[step], window)
    while in_lane and lane_kernels.answer_is_there(lane):
        status = receive_record(lane, plant_state.counts[STEP], forces, window, grant)
        if status != REACHED:
            return status
    return REACHED


@kernel(part=True)
def _send_forces(law, law_state, line, line_state, forces, lane, value):
    """Put the forces that are known after a sample of this value into the lane.

    Returns False if there was no room in time.
    """
    own, seen = lane.own, law_state.counts[laws.SAMPLES]
    if own[SAMPLES_PUT] == seen:
        return True
    end = line_state.counts[EMITTED]
    while own[FORCES_PUT] < end - 1:
        if not lane_kernels.wait_for_room(lane):
            return False
        force = forces[own[FORCES_PUT]]
        lane_kernels.put_answer(lane, own[SAMPLES_PUT], force, math.nan)
        own[FORCES_PUT] += 1
    if not lane_kernels.wait_for_room(lane):
        return False
    level = math.nan
    if controller_kernels.is_quiet(line_state):
        level = laws.quiet_level(law, law_state)
        if level == math.inf:
            level = math.nan
    force = math.nan
    if own[FORCES_PUT] < end:
        force = forces[own[FORCES_PUT]]
        own[FORCES_PUT] += 1
    lane_kernels.put_answer(lane, seen, force, level)
    own[SAMPLES_PUT] = seen
    if not value > level:
        own[lane_kernels.BROKEN_AT] = seen
    return True


@kernel
def answer_samples(
    law, law_state, line, line_state, forces, modes, delays, lane, first, limit, look_ahead
):
    """Answer samples in the lane from `first` on, up to `limit`. The controller's side.

    Writes the mode and the delay of the law after each. Ends early where exchanges are slow.
    """
    counts, rounds, began, value = law_state.counts, 0, now_ns(), math.nan
    while True:
        if not _send_forces(law, law_state, line, line_state, forces, lane, value):
            return SILENT
        rounds += 1
        slow = rounds % _LOOK_EVERY == 0 and now_ns() - began > lane.wait_ns
        if slow or counts[laws.SAMPLES] >= limit:
            return REACHED
        if not lane_kernels.wait_for_sample(lane, counts[laws.SAMPLES]):
            return SILENT
        for _ in range(_AT_ONCE):
            i = counts[laws.SAMPLES]
            if lane_kernels.sample_number(lane, i) != i + 1:
                return GAP
            value = lane_kernels.sample_value(lane, i)
            if not math.isfinite(value):
                return NO_NUMBER
            controller_kernels.control_sample(law, law_state, line, line_state, value, forces)
            modes[i - first] = law_state.record[laws.MODE]
            delays[i - first] = law_state.record[laws.DELAY]
            if i + 1 >= limit or not lane_kernels.sample_is_there(lane, i + 1):
                break
        if counts[laws.FAULT] != 0:
            return REACHED
        if look_ahead:
            controller_kernels.grant_ahead(law_state, line, line_state, forces)


@kernel(part=True)
def _any_force(forces, step, end):
    """Return whether a force after `step` and before `end` is not zero."""
    for j in range(step + 1, min(end, forces.size)):
        if forces[j] != 0.0:
            return True
    return False


@kernel(part=True)
def impact_is_over(
    impact, plant_state, sensor, sensor_state, law, law_state, line_state, forces, window, value
):
    """Return whether no later step can belong to the followed impact.

    Nothing pushes or is on its way, and the sphere has come back; or the law promises no force as
    long as samples stay above a level, and the sensor can show none below it until the sphere has
    come back. `value`: the latest sample.
    """
    if impact.counts[OVER] == 1:
        return True
    if not impact_kernels.is_silent(impact) or not controller_kernels.is_quiet(line_state):
        return False
    body = plant_state.body
    if body[ACTUATOR_F] != 0.0 or body[ACTUATOR_RATE] != 0.0:
        return False  # the actuator still answers
    if impact.counts[BACK] != 1:
        level = laws.quiet_level(law, law_state)
        if not value > level:
            return False
        if level != -math.inf:
            least, since = impact_kernels.least_gap(impact)
            if sensor.of_state != XI:
                least = -math.inf  # the gap says nothing of other quantities
            taken = window.counts[SAMPLES_END]
            if not sensor_kernels.least_sample(sensor, sensor_state, taken, least, since) > level:
                return False
    # The line says what comes from the emitted forces on, which latency puts ahead.
    return not _any_force(forces, plant_state.counts[STEP] - 1, line_state.counts[EMITTED])


@kernel
def closed_loop(
    plant,
    plant_state,
    sensor,
    sensor_state,
    law,
    law_state,
    line,
    line_state,
    forces,
    window,
    modes,
    delays,
    end,
    impact,
):
    """Run plant, sensor and controller together up to step `end`.

    If the first `impact` is followed, the loop ends as soon as no later step can belong to it;
    returns whether it did. A promise of the law lets the loop end earlier, with the same impact.
    """
    value = 0.0
    while plant_state.counts[STEP] < end:
        if observe(plant_state, sensor, sensor_state, window):
            at = window.counts[SAMPLES_END] - 1 - window.counts[SAMPLES_FIRST]
            value = window.values[at]
            controller_kernels.control_sample(law, law_state, line, line_state, value, forces)
            modes[at] = law_state.record[laws.MODE]
            delays[at] = law_state.record[laws.DELAY]
        step = plant_state.counts[STEP]
        gap = plant_state.body[XI]
        step_and_record(plant, plant_state, forces[step], window)
        if impact.quiet_steps < 0:
            continue
        impact_kernels.follow(impact, plant_state.body[F_C], plant_state.body[F_A], gap)
        if impact_is_over(
            impact,
            plant_state,
            sensor,
            sensor_state,
            law,
            law_state,
            line_state,
            forces,
            window,
            value,
        ):
            return True
    return False


@kernel
def loop_in_parts(
    plant,
    plant_state,
    sensor,
    sensor_state,
    law,
    law_state,
    line,
    line_state,
    forces,
    truth,
    parts,
    means,
):
    """Run the closed loop with a plant that takes `parts` steps in each step of the controller.

    The force is held over a step of the controller. With `means` the sensor follows the mean over
    that step, otherwise its end.
    """
    seen = plant_state.body[sensor.of_state]
    index = 0
    for step in range(forces.size):
        sensor_kernels.follow(sensor, sensor_state, seen)
        if step % sensor.every_steps == 0:
            value = sensor_kernels.sample(sensor, sensor_state, index)[1]
            index += 1
            controller_kernels.control_sample(law, law_state, line, line_state, value, forces)
        total = 0.0
        for part in range(parts):
            record_step(plant, plant_state, forces[step], truth, step * parts + part)
            total += plant_state.body[sensor.of_state]
        seen = total / parts if means else plant_state.body[sensor.of_state]
