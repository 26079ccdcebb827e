"""The controller's side: samples through law and signal path, from a block or from the ring."""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.bus import ring_kernels
from hertzloop.bus.ring_kernels import (
    FORCES_PUT,
    LAST_UNGRANTED,
    OPEN,
    SAMPLES_ANSWERED,
    Ring,
    now_ns,
)
from hertzloop.closed_loop import grant as grants
from hertzloop.closed_loop.exchange import GAP, NO_NUMBER, REACHED, SILENT
from hertzloop.common.jit import kernel
from hertzloop.controller import kernels as controller_kernels
from hertzloop.controller import law_kernels as laws

_AT_ONCE = 64  # samples that are answered together, if so many are there
_LOOK_EVERY = 8  # exchanges between two looks at the clock


class Job(NamedTuple):
    """Samples to answer, and what their answers say beside the forces.

    Attributes:
        values: Samples of a block, in the unit of their quantity; empty with a ring.
        ring: The controller's end of the shared memory.
        modes, delays: Of the law after each sample, from sample `first` on.
        trigger_level: Shape (1,): granted with the latest answer; inf without one.
        first: Number of the first sample of `modes`, and of `values`.
        commands_ahead: Whether to grant forces that the law knows beforehand.
    """

    values: np.ndarray
    ring: Ring
    modes: np.ndarray
    delays: np.ndarray
    trigger_level: np.ndarray
    first: int
    commands_ahead: bool


@kernel
def answer(controller, job, limit):
    """Answer samples up to number `limit`; ends early where exchanges in the ring are slow.

    Returns a status of the exchange.
    """
    ring, counts = job.ring, controller.law_state.counts
    in_ring, rounds, began, value = ring.own[OPEN] != 0, 0, now_ns(), math.nan
    at_once = _AT_ONCE if in_ring else limit
    while True:
        level = grants.trigger_level(controller)
        job.trigger_level[0] = level
        if in_ring:
            if not _put_answer(controller, ring, value, level):
                return SILENT
            rounds += 1
            if rounds % _LOOK_EVERY == 0 and now_ns() - began > ring.wait_ns:
                return REACHED
        if counts[laws.SAMPLES] >= limit:
            return REACHED
        if in_ring and not ring_kernels.wait_for_sample(ring, counts[laws.SAMPLES]):
            return SILENT
        for _ in range(at_once):
            i = counts[laws.SAMPLES]
            if not in_ring:
                value = job.values[i - job.first]
            elif ring_kernels.sample_number(ring, i) != i + 1:
                return GAP
            else:
                value = ring_kernels.sample_value(ring, i)
            if not math.isfinite(value):
                return NO_NUMBER
            controller_kernels.control_sample(
                controller.law,
                controller.law_state,
                controller.path,
                controller.path_state,
                value,
                controller.forces,
            )
            job.modes[i - job.first] = controller.law_state.record[laws.MODE]
            job.delays[i - job.first] = controller.law_state.record[laws.DELAY]
            if i + 1 >= limit or (in_ring and not ring_kernels.sample_is_there(ring, i + 1)):
                break
        if counts[laws.FAULT] != 0:
            return REACHED
        if job.commands_ahead:
            controller_kernels.schedule_ahead(
                controller.law_state,
                controller.path,
                controller.path_state,
                controller.forces,
            )


@kernel(copied=True)
def _put_answer(controller, ring, value, level):
    """Put the forces that are known after a sample of this value into the ring.

    Returns False if there was no room in time.
    """
    own, answered = ring.own, controller.law_state.counts[laws.SAMPLES]
    if own[SAMPLES_ANSWERED] == answered:
        return True
    end, forces = grants.known_until(controller), controller.forces
    while True:
        if not ring_kernels.wait_for_room(ring):
            return False
        force, last = math.nan, own[FORCES_PUT] >= end - 1
        if own[FORCES_PUT] < end:
            force = forces[own[FORCES_PUT]]
            own[FORCES_PUT] += 1
        if last:
            break
        ring_kernels.put_answer(ring, own[SAMPLES_ANSWERED], force, math.nan)
    ring_kernels.put_answer(ring, answered, force, level if level < math.inf else math.nan)
    own[SAMPLES_ANSWERED] = answered
    if not value > level:
        own[LAST_UNGRANTED] = answered
    return True
