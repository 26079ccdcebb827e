"""Compiled kernels: a law as the loop sees it, four addresses and the bytes of two records.

The addresses are those of C functions (hertzloop_law.h), whatever the law was written in, so the
loop is compiled once for all laws. The first two words of every state are mode and delay.
"""

import ctypes
import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.extending import intrinsic

from hertzloop.common.jit import kernel

# Indices into the state's words, and into the counts kept beside it. COMMANDED: samples whose
# command is known, some perhaps ahead. FAULT: sample, from 1 on, on which the law failed. CAUSE:
# NO_NUMBER, a command of it is not finite; OTHER_THAN_AHEAD, it is not the one known ahead;
# NOT_QUIET, it is a force against the promise of none.
MODE, DELAY = range(2)
SAMPLES, COMMANDED, FAULT, CAUSE = range(4)
LAW_COUNTS = 4
NO_NUMBER, OTHER_THAN_AHEAD, NOT_QUIET = range(3)
# Indices into the state's numbers: level above which samples leave the law at zero by all its
# promises that still hold, inf without any; what was promised and commanded at a fault.
QUIET_ABOVE, PROMISED, COMMAND = range(3)
LAW_NUMBERS = 3


class LawModel(NamedTuple):
    """Addresses of a law's functions, 0 where it has none, and the bytes of its parameters."""

    command: int
    known_ahead: int
    command_ahead: int
    trigger_level: int
    parameters: np.ndarray


class LawState(NamedTuple):
    """Counts and numbers by the indices above; all samples so far, and the commands known ahead, by
    sample; the law's state as 64-bit words."""

    counts: np.ndarray
    numbers: np.ndarray
    history: np.ndarray
    ahead: np.ndarray
    record: np.ndarray


def first_state(record: np.ndarray, samples: int) -> LawState:
    """A law's state before the first of so many samples; `record`: its words at the start.

    Samples that are not yet taken are NaN. A law that reads one commands NaN, which ends the run.
    """
    numbers = np.zeros(LAW_NUMBERS)
    numbers[QUIET_ABOVE] = math.inf
    counts, history = np.zeros(LAW_COUNTS, np.int64), np.full(samples, math.nan)
    return LawState(counts, numbers, history, np.empty(samples), record.copy())


_KINDS: dict[str, tuple[Any, Any]] = {
    "double": (types.float64, ctypes.c_double),
    "int64": (types.int64, ctypes.c_int64),
}


@lru_cache(maxsize=256)
def _function_at(address: int, result: str, arguments: int) -> Any:
    """The C function at an address, for Python; each argument is a word."""
    return ctypes.CFUNCTYPE(_KINDS[result][1], *([ctypes.c_int64] * arguments))(address)


def _caller(result: str) -> Any:
    """A function that calls the C function at an address with arrays and whole numbers, for
    compiled code or for Python."""
    if config.DISABLE_JIT:

        def call_in_python(address: int, given: tuple[Any, ...]) -> Any:
            words = [v.ctypes.data if isinstance(v, np.ndarray) else int(v) for v in given]
            return _function_at(address, result, len(words))(*words)

        return call_in_python

    def codegen(context: BaseContext, builder: Any, signature: Any, values: Any) -> Any:
        # It takes 40 ms to import, and only a process that compiles needs it.
        from numba.np.arrayobj import make_array

        kinds = signature.args[1].types
        words = cgutils.unpack_tuple(builder, values[1], len(kinds))
        for at, kind in enumerate(kinds):
            if isinstance(kind, types.Array):
                data = make_array(kind)(context, builder, words[at]).data
                words[at] = builder.bitcast(data, ir.IntType(8).as_pointer())
        back = context.get_value_type(signature.return_type)
        c_function = ir.FunctionType(back, [word.type for word in words])
        return builder.call(builder.inttoptr(values[0], c_function.as_pointer()), words)

    @intrinsic
    def call(typingctx, address, given):
        return _KINDS[result][0](types.int64, given), codegen

    return call


_call_double, _call_int64 = _caller("double"), _caller("int64")


@kernel(part=True)
def _fail(state, index, cause, promised, command):
    """Note the first fault of a law, at sample `index`."""
    if state.counts[FAULT] == 0:
        state.counts[FAULT] = index + 1
        state.counts[CAUSE] = cause
        state.numbers[PROMISED] = promised
        state.numbers[COMMAND] = command


@kernel(part=True)
def _number(state, index, command):
    """The command, or zero, with the fault noted, where it is no number."""
    if math.isfinite(command):
        return command
    _fail(state, index, NO_NUMBER, 0.0, 0.0)
    return 0.0


@kernel(part=True)
def _as_promised(state, index, value, command):
    """The command of a sample, with the fault noted where it breaks what the law said before.

    Of two zeros it is the one that was promised, so that their signs do not depend on who asked.
    """
    counts, numbers = state.counts, state.numbers
    if index < counts[COMMANDED]:
        if command != state.ahead[index]:
            _fail(state, index, OTHER_THAN_AHEAD, state.ahead[index], command)
        command = state.ahead[index]
    if not value > numbers[QUIET_ABOVE]:
        numbers[QUIET_ABOVE] = math.inf  # the law is free of all its promises
    else:
        if command != 0.0:
            _fail(state, index, NOT_QUIET, numbers[QUIET_ABOVE], command)
        command = 0.0
    return command


@kernel
def trigger_level(model, state):
    """Level above which samples leave the law at zero from now on; inf without such a promise."""
    if model.trigger_level == 0:
        return math.inf
    level = _call_double(model.trigger_level, (model.parameters, state.record))
    return level if level < math.inf else math.inf


@kernel(part=True)
def _ask_ahead(model, state, last):
    """Ask the law, after sample `last`, for the commands that it knows and has not given yet."""
    if model.known_ahead == 0:
        return
    counts, history = state.counts, state.history
    known = _call_int64(model.known_ahead, (model.parameters, state.record, history, last))
    for index in range(counts[COMMANDED], last + 1 + min(known, history.size - last - 1)):
        command = _call_double(
            model.command_ahead, (model.parameters, state.record, history, last, index)
        )
        state.ahead[index] = _number(state, index, command)
        counts[COMMANDED] = index + 1


@kernel(part=True)
def command_for_sample(model, state, value):
    """Feed the next sample to the law, and note what it promises from now on. Returns its command,
    N."""
    counts, numbers, history = state.counts, state.numbers, state.history
    index = counts[SAMPLES]
    history[index] = value
    counts[SAMPLES] = index + 1
    command = _call_double(model.command, (model.parameters, state.record, history, index))
    command = _as_promised(state, index, value, _number(state, index, command))
    counts[COMMANDED] = max(counts[COMMANDED], index + 1)
    _ask_ahead(model, state, index)
    numbers[QUIET_ABOVE] = min(numbers[QUIET_ABOVE], trigger_level(model, state))
    return command
