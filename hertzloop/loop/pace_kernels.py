"""Compiled kernels of paced mode: the plant follows the wall clock and waits for no force.

See docs/how-to/paced.md. Nothing allocates.
"""

from typing import NamedTuple

import numpy as np

from hertzloop.bus import lane_kernels
from hertzloop.bus.lane_kernels import OPEN, now_ns, sleep_us, yield_core
from hertzloop.common.jit import kernel
from hertzloop.loop import kernels as loop_kernels
from hertzloop.loop.kernels import (
    FORCES_END,
    GRANTED_END,
    PROMISED,
    REACHED,
    SAMPLES_END,
    SAMPLES_FIRST,
    SEEN,
    SILENT,
)
from hertzloop.plant.state_kernels import STEP

# Indices into Pace.counts. START_NS: when step 0 was due; PUT: samples put into the lane; the
# longest response, lateness of a force and lag of the plant behind the clock; time spent waiting
# for the clock.
START_NS, PUT, RESPONSE_MAX_NS, LATE_MAX_NS, BEHIND_MAX_NS, WAITED_NS = range(6)

PACE_COUNTS = 6
# Status of `follow` besides those of loop.kernels: too many unanswered samples for the ring.
FULL = 100
# The histogram has 32 classes an octave, so that a class is 3 % wide at most; up to 2**40 ns.
CLASSES_AN_OCTAVE, CLASSES = 32, 32 * 36
# Before a step that is due in more than _SOON_NS, and with nothing expected, the core sleeps for
# _SLEEP_US; before one due in more than _NEAR_NS it is yielded; otherwise the kernel spins.
_SLEEP_US, _SOON_NS, _NEAR_NS = 50, 200_000, 20_000


class Pace(NamedTuple):
    """What paced mode needs of its own; times are of the monotonic clock, ns."""

    held: np.ndarray  # int32 (steps,): how many steps older than its step the command was
    values: np.ndarray  # samples not in the lane yet, a ring whose size is a power of two
    taken_ns: np.ndarray  # when they were taken, a ring of the same size
    counts: np.ndarray
    histogram: np.ndarray  # answers by response time, (CLASSES,)
    step_ns: float  # wall time of a step


@kernel(inline=True)
def due_ns(pace, step):
    """When a step is due."""
    return pace.counts[START_NS] + np.int64(step * pace.step_ns)


@kernel(inline=True)
def class_of(ns):
    """Class of the histogram that a time belongs to."""
    shift = 0
    while (ns >> shift) >= 2 * CLASSES_AN_OCTAVE:
        shift += 1
    return min(max(0, shift * CLASSES_AN_OCTAVE + (ns >> shift)), CLASSES - 1)


@kernel
def note_answers(pace, now, first, end):
    """Samples `first` to `end` - 1 were answered."""
    for i in range(first, end):
        took = now - pace.taken_ns[i & (pace.taken_ns.size - 1)]
        pace.histogram[class_of(took)] += 1
        pace.counts[RESPONSE_MAX_NS] = max(pace.counts[RESPONSE_MAX_NS], took)


@kernel
def note_forces(pace, now, first, end):
    """Forces of steps `first` to `end` - 1 came, some of them perhaps late."""
    for at in range(first, end):
        if pace.held[at] > 0:
            late = now - due_ns(pace, at)
            pace.counts[LATE_MAX_NS] = max(pace.counts[LATE_MAX_NS], late)
            return  # the oldest is the latest


@kernel(inline=True)
def _receive_records(now, step, forces, window, grant, lane, pace):
    """Take the answers that are in the lane."""
    counts = grant.counts
    while lane_kernels.answer_is_there(lane):
        seen, at = counts[SEEN], counts[FORCES_END]
        # A step that went without its force was promised nothing.
        late = at < pace.held.size and pace.held[at] > 0
        status = loop_kernels.receive_record(lane, at if late else step, forces, window, grant)
        if status != REACHED:
            return status
        note_answers(pace, now, seen, counts[SEEN])
        note_forces(pace, now, at, counts[FORCES_END])
    return REACHED


@kernel(inline=True)
def _put(window, grant, lane, pace):
    """Put samples into the lane, as far as there is room."""
    end = min(window.counts[SAMPLES_END], grant.counts[SEEN] + lane.slots)
    for i in range(pace.counts[PUT], end):
        lane_kernels.put_sample(lane, i, pace.values[i & (pace.values.size - 1)])
        pace.counts[PUT] = i + 1


@kernel(inline=True)
def _wait(left_ns, quiet, lane):
    """Let some time pass before a step that is due in `left_ns`; `quiet`: nothing is awaited."""
    if quiet and left_ns > _SOON_NS:
        sleep_us(_SLEEP_US)
    elif left_ns > _NEAR_NS or lane.spins == 0:
        yield_core()


@kernel
def follow(plant, plant_state, sensor, sensor_state, forces, window, grant, lane, pace, end):
    """Take the steps before `end` when they are due, each under its force if that has come, else
    under the newest that has. Ends as SILENT when it is time to look at the bus: without a lane
    whenever the next step is not due yet."""
    counts, clock = grant.counts, pace.counts
    in_lane = lane.own[OPEN] != 0
    began = now_ns()
    latest = began  # sample
    while True:
        now, step = now_ns(), plant_state.counts[STEP]
        if in_lane:
            status = _receive_records(now, step, forces, window, grant, lane, pace)
            if status != REACHED:
                return status
            _put(window, grant, lane, pace)
        if step >= end:
            return REACHED
        behind = now - due_ns(pace, step)
        if behind < 0:
            if not in_lane or now - began > lane.wait_ns:
                return SILENT
            quiet = counts[SEEN] == window.counts[SAMPLES_END] or now - latest > _SOON_NS
            _wait(-behind, quiet, lane)
            clock[WAITED_NS] += now_ns() - now
            continue
        if behind > clock[BEHIND_MAX_NS]:
            clock[BEHIND_MAX_NS] = behind
        if loop_kernels.observe(plant_state, sensor, sensor_state, window):
            index = window.counts[SAMPLES_END] - 1
            if index - counts[SEEN] >= pace.values.size:
                return FULL
            value = window.values[index - window.counts[SAMPLES_FIRST]]
            pace.values[index & (pace.values.size - 1)] = value
            pace.taken_ns[index & (pace.values.size - 1)] = now
            latest = now
            loop_kernels.check_threshold(step, value, window, grant)
            if in_lane:
                _put(window, grant, lane, pace)
        held = 0
        if counts[PROMISED] == 0 and step >= counts[GRANTED_END]:
            held = step + 1 - counts[GRANTED_END]
        pace.held[step] = held
        loop_kernels.step_and_record(plant, plant_state, forces[step - held], window)
