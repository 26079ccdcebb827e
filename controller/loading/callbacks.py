"""A law's functions as C functions that call back into Python: for what Numba cannot compile."""

import ctypes
import math
import numbers
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from types import FunctionType
from typing import Any

import numpy as np

from hertzloop.common.uncompiled import plain
from hertzloop.controller.loading.compiled import FUNCTIONS

_RESULTS: dict[str, Any] = {"double": ctypes.c_double, "int64": ctypes.c_int64}


def uncompiled(function: Any, made: dict[Any, Any] | None = None) -> Any:
    """The Python function behind a compiled one, which calls such functions only."""
    made = {} if made is None else made
    if function not in made:
        code = plain(function)
        names = dict(code.__globals__)
        made[function] = FunctionType(
            code.__code__, names, code.__name__, code.__defaults__, code.__closure__
        )
        for name in code.__code__.co_names:
            if hasattr(names.get(name), "py_func"):
                names[name] = uncompiled(names[name], made)
    return made[function]


class UnknownSample(IndexError):
    """A law reads a sample that it is not given."""


class KnownSamples(np.ndarray):
    """The samples that a law is given: to read another one is an error, before the first as well,
    where Python would count from the end."""

    def __getitem__(self, index: Any) -> Any:
        """Samples. Raises UnknownSample."""
        if isinstance(index, int | np.integer) and not 0 <= index < len(self):
            when = "is not known yet" if index > 0 else "does not exist"
            raise UnknownSample(
                f"samples[{index}] {when}; at sample {len(self) - 1} a law may read samples[0] to "
                f"samples[{len(self) - 1}]"
            )
        return self.view(np.ndarray)[index]


def state_view(words: np.ndarray, dtype: np.dtype) -> Any:
    """A state's fields as attributes that can be set; `words` are the record's."""
    return words.view(dtype).view(np.recarray)[0]


def python_functions(
    home: Any, constants: Any, state: np.dtype, wanted: Iterable[str], ended: list[BaseException]
) -> dict[str, Any]:
    """Those `wanted` that a law has, as C functions by name; what a law raises, or returns that
    is no number, becomes nan. What is to end more than the law, as Ctrl-C is, cannot pass through
    compiled code: it is added to `ended`, to be raised behind it, and the law fails until then."""
    return {
        name: _callback(plain(getattr(home, name)), *FUNCTIONS[name], constants, state, ended)
        for name in wanted
        if callable(getattr(home, name, None))
    }


def addresses_of(functions: Mapping[str, Any]) -> dict[str, int]:
    """Addresses of C functions by name."""
    return {
        name: ctypes.cast(function, ctypes.c_void_p).value or 0
        for name, function in functions.items()
    }


def _callback(
    function: Any,
    result: str,
    arguments: str,
    constants: Any,
    state: np.dtype,
    ended: list[BaseException],
) -> Any:
    seen: dict[int, Any] = {}  # states by address

    def view(address: int) -> Any:
        if address not in seen:
            words = (ctypes.c_int64 * (state.itemsize // 8)).from_address(address)
            seen[address] = state_view(np.frombuffer(words, np.int64), state)
        return seen[address]

    convert: Any
    convert, failed = (float, math.nan) if result == "double" else (int, -1)

    def call(p: int, s: int, *rest: int) -> Any:
        try:
            if ended:
                return failed
            if arguments:
                known = (ctypes.c_double * (rest[1] + 1)).from_address(rest[0])
                value = function(constants, view(s), np.frombuffer(known), *rest[1:])
            else:
                value = function(constants, view(s))
            # pyrefly: ignore[bad-argument-type]
            return convert(value) if isinstance(value, numbers.Real) else failed
        except (Exception, SystemExit):
            return failed
        except BaseException as error:
            ended.append(error)
            return failed

    _hear_of(call, ended)
    pointers: list[Any] = [ctypes.c_void_p] * (3 if arguments else 2)
    integers: list[Any] = [ctypes.c_int64] * arguments.count(",")
    return ctypes.CFUNCTYPE(_RESULTS[result], *pointers, *integers)(call)


def _hear_of(call: Any, ended: list[BaseException]) -> None:
    """Have what is raised at the very start of a call, before its `try`, added to `ended`: ctypes
    hands that to a hook, and lets C go on."""
    call.ended_law = ended
    before = sys.unraisablehook
    if getattr(before, "hears_laws", False):
        return

    def hook(unraisable: Any) -> None:
        ended = getattr(unraisable.object, "ended_law", None)
        if ended is None or unraisable.exc_value is None:
            before(unraisable)
        else:
            ended.append(unraisable.exc_value)

    hook.hears_laws = True  # type: ignore[attr-defined]
    sys.unraisablehook = hook


PATIENCE_S = 20.0


class LawTimeout(BaseException):
    """Raised in whatever is overdue; no Exception, which a law might catch."""


@contextmanager
def given_up_in_time(patience_s: float | None = None) -> Iterator[None]:
    """Raise LawTimeout out of the Python code inside when it takes longer than `patience_s`."""
    thread, over, lock = ctypes.c_ulong(threading.get_ident()), False, threading.Lock()
    interrupt = ctypes.pythonapi.PyThreadState_SetAsyncExc

    def give_up() -> None:
        # Never to be taken back: CPython 3.11 would count one as under way for ever, and go round
        # in circles for whoever traces it (a debugger, a measurement of coverage).
        with lock:
            if not over:
                interrupt(thread, ctypes.py_object(LawTimeout))

    timer = threading.Timer(patience_s or PATIENCE_S, give_up)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        with lock:  # one that comes late is raised here
            over = True
