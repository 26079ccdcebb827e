"""The promise of zero force, as answers over the bus and in shared memory begin and end it."""

import math
from itertools import product

import numpy as np
import pytest

from hertzloop.bus.messages_pb2 import ForceBlock
from hertzloop.loop import kernels as loop_kernels
from hertzloop.loop.force_buffer import ForceBuffer
from hertzloop.loop.kernels import (
    BROKEN_AT,
    PROMISED,
    REACHED,
    SAMPLES_END,
    SAMPLES_FIRST,
    WINDOW_COUNTS,
    Window,
)
from tests.hertzloop.short_runs import scene

TAKEN, LEVEL = 9, 1.0  # samples, and the level of the promise before
SEEN, BROKEN = (5, TAKEN), (0, 5, 6, TAKEN)  # samples answered; taken when one fell to the level
CASES = list(product((False, True), SEEN, BROKEN, (None, LEVEL, 2.0)))


def buffer_after(promised, broken_at):
    none = np.zeros(0)
    window = Window(np.zeros((0, 0)), none, none, none, np.zeros(WINDOW_COUNTS, np.int64))
    window.counts[[SAMPLES_FIRST, SAMPLES_END]] = TAKEN
    buffer = ForceBuffer(scene(), window)
    buffer.grant.level[0] = LEVEL
    buffer.grant.counts[PROMISED], buffer.grant.counts[BROKEN_AT] = promised, broken_at
    return buffer, window


def over_the_bus(promised, seen, broken_at, level):
    """Promise and level after an answer; without a promise the header still has a level."""
    buffer, _ = buffer_after(promised, broken_at)
    header = ForceBlock(
        samples_seen=seen,
        promise_zero=level is not None,
        promise_level=7.0 if level is None else level,
    )
    buffer.receive(header, np.zeros(1), 0)
    return bool(buffer.grant.counts[PROMISED]), float(buffer.grant.level[0])


def in_the_lane(promised, seen, broken_at, level):
    buffer, window = buffer_after(promised, broken_at)
    status = loop_kernels._accept_record(
        0, seen, 0.0, math.nan if level is None else level, buffer.forces, window, buffer.grant
    )
    assert status == REACHED
    return bool(buffer.grant.counts[PROMISED]), float(buffer.grant.level[0])


@pytest.mark.parametrize(("promised", "seen", "broken_at", "level"), CASES)
def test_an_answer_means_the_same_over_the_bus_and_in_the_lane(promised, seen, broken_at, level):
    before = promised, LEVEL
    kept = before if level is None else (True, level)
    if seen == TAKEN:
        expected = (False, LEVEL) if level is None else kept
    elif seen < broken_at or level == 2.0:
        expected = before  # a sample taken since then may have broken it
    else:
        expected = (level is not None, LEVEL)
    assert over_the_bus(promised, seen, broken_at, level) == expected
    assert in_the_lane(promised, seen, broken_at, level) == expected
