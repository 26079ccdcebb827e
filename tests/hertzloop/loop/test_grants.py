"""The trigger level: an answer means the same over the bus and in shared memory."""

import math
from itertools import product

import numpy as np
import pytest

from hertzloop.bus.messages_pb2 import ForceBlock
from hertzloop.closed_loop.exchange import (
    GO,
    LOCK_STEP,
    SAMPLES_END,
    SAMPLES_FIRST,
    Exchange,
    Unsent,
    accept_record,
)
from hertzloop.closed_loop.grant import TRIGGERED, ZERO_UNTIL_TRIGGER
from hertzloop.closed_loop.parts import elsewhere, empty_unsent, exchange
from hertzloop.loop.plant_exchange import accept_block

TAKEN, LEVEL = 9, 1.0  # samples, and the trigger level before
SEEN, TRIGGERS = (5, TAKEN), (0, 5, 6, TAKEN)  # samples answered; taken when one fell to the level
CASES = list(product((False, True), SEEN, TRIGGERS, (None, LEVEL, 2.0)))


def exchange_after(zero: bool, triggered: int, sent: int) -> tuple[Exchange, Unsent]:
    unsent, found = empty_unsent(0, 0), exchange(LOCK_STEP, elsewhere(np.zeros(100)))
    unsent.counts[SAMPLES_FIRST], unsent.counts[SAMPLES_END] = sent, TAKEN
    found.grant.trigger_level[0] = LEVEL
    found.grant.counts[ZERO_UNTIL_TRIGGER], found.grant.counts[TRIGGERED] = zero, triggered
    return found, unsent


def granted(found: Exchange) -> tuple[bool, float]:
    return bool(found.grant.counts[ZERO_UNTIL_TRIGGER]), float(found.grant.trigger_level[0])


def over_the_bus(zero, seen, triggered, level):
    """Whether the force is zero, and the level, after an answer to all samples that were sent; a
    header always has a level."""
    found, unsent = exchange_after(zero, triggered, sent=seen)
    header = ForceBlock(
        samples_seen=seen,
        zero_until_trigger=level is not None,
        trigger_level=7.0 if level is None else level,
    )
    accept_block(found, unsent, header, np.zeros(1), 0)
    return granted(found)


def in_the_ring(zero, seen, triggered, level):
    found, unsent = exchange_after(zero, triggered, sent=TAKEN)
    assert accept_record(found, unsent, 0, seen, 0.0, math.nan if level is None else level) == GO
    return granted(found)


@pytest.mark.parametrize(("zero", "seen", "triggered", "level"), CASES)
def test_an_answer_means_the_same_over_the_bus_and_in_the_ring(zero, seen, triggered, level):
    before = zero, LEVEL
    kept = before if level is None else (True, level)
    if seen == TAKEN:
        expected = (False, LEVEL) if level is None else kept
    elif seen < triggered or level == 2.0:
        expected = before  # a sample taken since then may have triggered
    else:
        expected = (level is not None, LEVEL)
    assert over_the_bus(zero, seen, triggered, level) == expected
    assert in_the_ring(zero, seen, triggered, level) == expected
