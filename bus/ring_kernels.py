"""Compiled kernels of the two rings in shared memory, as hertzloop_ring.h has them in C.

See docs/reference/shared-memory.md.
"""

import os
import time
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from hertzloop.common.jit import kernel

# Words of the segment.
MAGIC, VERSION, RUN_ID, SLOTS, STEPS, EVERY_STEPS, JOINED, CLOSED = range(8)
ANSWERS_TAKEN, SAMPLE_RING = 16, 32
SAMPLE_WORDS, ANSWER_WORDS = 2, 4
# What one end counts for itself. FORCES_PUT: steps whose force the controller has put into the
# ring, SAMPLES_ANSWERED: samples that it has answered there.
# LAST_UNGRANTED: samples that the controller had answered when it last answered one without a
# trigger level.
OPEN, TAKEN, PUT, ROOM, FORCES_PUT, SAMPLES_ANSWERED, LAST_UNGRANTED = range(7)
OWN_COUNTS = 7
# No ints: Numba would compile `_wait_slowly` once for each value.
_SLEEP_US, _AT_ONCE = np.int64(50), np.int64(0)
_REST_AFTER = 1000  # samples under a trigger level; they took longer than a rest may delay


class Ring(NamedTuple):
    """One end of the ring: the segment as integers and, the same memory, as doubles; this end's
    counts; looks before it lets others run, how long it does that and waits at all (ns), and how
    long the controller sleeps between looks where the plant does not wait for it (us), 0 for never.
    """

    words: np.ndarray
    numbers: np.ndarray
    own: np.ndarray
    slots: int
    spins: int
    yield_ns: int
    wait_ns: int
    rest_us: int


@kernel
def _wait_slowly(ring, at, expected, yield_ns, rest_us):
    """Wait for `expected` in word `at`, letting others run for `yield_ns` and then sleeping for
    `rest_us` at a time; False after `wait_ns`, or once a side has left."""
    began, waited = now_ns(), 0
    while load_acquire(ring.words, at) < expected:
        if waited > ring.wait_ns or load_acquire(ring.words, CLOSED) != 0:
            break
        if waited < yield_ns:
            yield_core()
        else:
            sleep_us(rest_us)
        waited = now_ns() - began
    return load_acquire(ring.words, at) >= expected


@kernel(inline=True)
def _wait(ring, at, expected):
    """Wait until word `at`, which grows, has reached `expected`; False if it did not in time."""
    for _ in range(ring.spins):
        if load_acquire(ring.words, at) >= expected:
            return True
    return _wait_slowly(ring, at, expected, ring.yield_ns, _SLEEP_US)


@kernel(inline=True)
def _sample_slot(ring, i):
    return SAMPLE_RING + (i & (ring.slots - 1)) * SAMPLE_WORDS


@kernel(inline=True)
def _answer_slot(ring, i):
    answers = SAMPLE_RING + ring.slots * SAMPLE_WORDS
    return answers + (i & (ring.slots - 1)) * ANSWER_WORDS


@kernel(inline=True)
def put_sample(ring, i, value):
    """The plant: write sample `i`; the one a lap before must have been answered."""
    at = _sample_slot(ring, i)
    ring.numbers[at + 1] = value
    store_release(ring.words, at, i + 1)


@kernel(inline=True)
def sample_is_there(ring, i):
    """Whether sample `i` can be taken."""
    return load_acquire(ring.words, _sample_slot(ring, i)) >= i + 1


@kernel(inline=True)
def wait_for_sample(ring, i):
    """Wait for sample `i`; False if it did not come in time. Where the plant has been running ahead
    under a promise for a while, it does not wait for the answer, and the core is left to others."""
    at = _sample_slot(ring, i)
    if ring.rest_us == 0 or i - ring.own[LAST_UNGRANTED] < _REST_AFTER:
        return _wait(ring, at, i + 1)
    return _wait_slowly(ring, at, i + 1, _AT_ONCE, ring.rest_us)


@kernel(inline=True)
def sample_number(ring, i):
    """What stands as number in the place of sample `i`: i + 1, or something was lost."""
    return ring.words[_sample_slot(ring, i)]


@kernel(inline=True)
def sample_value(ring, i):
    """Sample `i`, which is there."""
    return ring.numbers[_sample_slot(ring, i) + 1]


@kernel(inline=True)
def wait_for_room(ring):
    """The controller: wait until the next record may be written; False if not in time."""
    own = ring.own
    if own[PUT] < own[ROOM]:
        return True
    if not _wait(ring, ANSWERS_TAKEN, own[PUT] + 1 - ring.slots):
        return False
    own[ROOM] = ring.slots + load_acquire(ring.words, ANSWERS_TAKEN)
    return True


@kernel(inline=True)
def put_answer(ring, samples, force, level):
    """The controller: write the next record, for which there is room."""
    i = ring.own[PUT]
    at = _answer_slot(ring, i)
    ring.words[at + 1] = samples
    ring.numbers[at + 2] = force
    ring.numbers[at + 3] = level
    store_release(ring.words, at, i + 1)
    ring.own[PUT] = i + 1


@kernel(inline=True)
def answer_is_there(ring):
    """Whether the next record of an answer can be taken."""
    i = ring.own[TAKEN]
    return load_acquire(ring.words, _answer_slot(ring, i)) >= i + 1


@kernel(inline=True)
def wait_for_answer(ring):
    """Wait for the next record of an answer; False if it did not come in time."""
    i = ring.own[TAKEN]
    return _wait(ring, _answer_slot(ring, i), i + 1)


@kernel(inline=True)
def receive_force(ring):
    """The next record, which is there: its number less the expected one, samples, force, level."""
    i = ring.own[TAKEN]
    at = _answer_slot(ring, i)
    excess = ring.words[at] - (i + 1)
    samples, force, level = ring.words[at + 1], ring.numbers[at + 2], ring.numbers[at + 3]
    ring.own[TAKEN] = i + 1
    store_release(ring.words, ANSWERS_TAKEN, i + 1)
    return excess, samples, force, level


_WORD, _HALF = ir.IntType(64), ir.IntType(32)

if config.DISABLE_JIT:

    def load_acquire(words: Any, at: int) -> int:
        """Word `at`; what was written before it is seen after it."""
        return int(words[at])

    def store_release(words: Any, at: int, value: int) -> None:
        """Set word `at`; who sees it sees what was written before."""
        words[at] = value

    def now_ns() -> int:
        """Monotonic clock, ns."""
        return time.monotonic_ns()

    def yield_core() -> None:
        """Let another process of this core run."""
        os.sched_yield()

    def sleep_us(duration: int) -> None:
        """Sleep."""
        time.sleep(duration * 1e-6)

else:

    def _word_at(context: Any, builder: Any, kind: Any, array: Any, at: Any) -> Any:
        return builder.gep(make_array(kind)(context, builder, array).data, [at])

    @intrinsic
    def load_acquire(typingctx, words, at):
        """Word `at`; what was written before it is seen after it."""

        def codegen(context, builder, signature, values):
            place = _word_at(context, builder, signature.args[0], *values)
            return builder.load_atomic(place, "acquire", 8)

        return types.int64(words, types.int64), codegen

    @intrinsic
    def store_release(typingctx, words, at, value):
        """Set word `at`; who sees it sees what was written before."""

        def codegen(context, builder, signature, values):
            place = _word_at(context, builder, signature.args[0], values[0], values[1])
            builder.store_atomic(values[2], place, "release", 8)
            return context.get_dummy_value()

        return types.void(words, types.int64, types.int64), codegen

    def _c_function(builder: Any, name: str, result: Any, arguments: list[Any]) -> Any:
        kind = ir.FunctionType(result, arguments)
        return cgutils.get_or_insert_function(builder.module, kind, name)

    @intrinsic
    def now_ns(typingctx):
        """Monotonic clock, ns."""

        def codegen(context, builder, signature, values):
            read = _c_function(builder, "clock_gettime", _HALF, [_HALF, _WORD.as_pointer()])
            pair = cgutils.alloca_once(builder, _WORD, size=2)
            builder.call(read, [_HALF(time.CLOCK_MONOTONIC), pair])
            second = builder.load(pair)
            rest = builder.load(builder.gep(pair, [_WORD(1)]))
            return builder.add(builder.mul(second, _WORD(10**9)), rest)

        return types.int64(), codegen

    @intrinsic
    def yield_core(typingctx):
        """Let another process of this core run."""

        def codegen(context, builder, signature, values):
            builder.call(_c_function(builder, "sched_yield", _HALF, []), [])
            return context.get_dummy_value()

        return types.void(), codegen

    @intrinsic
    def sleep_us(typingctx, duration):
        """Sleep."""

        def codegen(context, builder, signature, values):
            sleep = _c_function(builder, "usleep", _HALF, [_HALF])
            builder.call(sleep, [builder.trunc(values[0], _HALF)])
            return context.get_dummy_value()

        return types.void(types.int64), codegen
