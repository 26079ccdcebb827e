"""What compiled loops of two processes need to wait for each other: ordered loads and stores, a
clock, and ways to let others run."""

import os
import time
from typing import Any

from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

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
