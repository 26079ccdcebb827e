"""A law with its constants, ready to be called by the compiled loop."""

import ctypes
import math
import numbers
import sys
import threading
import time
import traceback
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from threading import Lock
from types import FunctionType
from typing import Any

import numpy as np

from controller.law_kernels import LAW_COUNTS, LawModel, LawState, quiet_level
from controller.loading.compiled import FUNCTIONS, UNCOMPILED, Entries, Packed, pack, state_of

_RESULTS: dict[str, Any] = {"double": ctypes.c_double, "int64": ctypes.c_int64}


def plain(function: Any) -> Any:
    """The Python function behind a compiled one."""
    return getattr(function, "py_func", function)


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


class Known(np.ndarray):
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


class Overdue(BaseException):
    """Raised in whatever is overdue; no Exception, which a law might catch."""


@contextmanager
def given_up_in_time(patience_s: float | None = None) -> Iterator[None]:
    """Raise Overdue out of the Python code inside when it takes longer than `patience_s`."""
    thread, over, lock = ctypes.c_ulong(threading.get_ident()), False, threading.Lock()
    interrupt = ctypes.pythonapi.PyThreadState_SetAsyncExc

    def give_up() -> None:
        # Never to be taken back: CPython 3.11 would count one as under way for ever, and go round
        # in circles for whoever traces it (a debugger, a measurement of coverage).
        with lock:
            if not over:
                interrupt(thread, ctypes.py_object(Overdue))

    timer = threading.Timer(patience_s or PATIENCE_S, give_up)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        with lock:  # one that comes late is raised here
            over = True


class LawFault(RuntimeError):
    """A law failed in a run; the sentence names it, the sample and what it did."""


class BoundLaw:
    """A law's functions, the bytes of its constants, and its state at the start.

    `trouble`: why it runs as Python, empty if it is compiled.
    """

    def __init__(
        self, name: str, addresses: Mapping[str, int], constants: Packed, state: Packed, held: Any
    ) -> None:
        self.name, self.trouble = name, ""
        at: list[Any] = [addresses.get(function, 0) for function in FUNCTIONS]
        self.model = LawModel(*[*at, constants.data])
        self._state, self._held = state, (constants, held)

    @cached_property
    def ended(self) -> list[BaseException]:
        """What was raised in the law that is to end more than the law, as Ctrl-C is."""
        return []

    def new_state(self) -> np.ndarray:
        """Words of the state at the start of a run."""
        return self._state.data.copy()

    @cached_property
    def waits_above(self) -> float:
        """Level above which samples leave the law at zero, as it is at the start; inf without."""
        state = LawState(np.zeros(LAW_COUNTS, np.int64), np.zeros(0), self.new_state())
        return float(quiet_level(self.model, state))

    def explain(self, samples: np.ndarray, index: int) -> str:
        """One sentence on what the law did wrong at sample `index`."""
        return f"the law {self.name} gave no finite number as the command of sample {index}"

    def reads_unknown(self, samples: np.ndarray) -> str:
        """One sentence on a sample that the law reads but is not given, as far as its text can
        tell; empty if there is none."""
        return ""


class BoundPython(BoundLaw):
    """The same of a law written in Python; `constants` are what it sees as `p`.

    With `ahead` false it has `command` alone: what it knows of later samples is not asked for.
    """

    def __init__(
        self, name: str, digest: str, home: Any, constants: Any, ahead: bool = True
    ) -> None:
        fields = constants._asdict() if hasattr(constants, "_asdict") else vars(constants)
        packed, state = pack(fields), state_of(home)
        self._home, self._constants = home, _with_arrays(constants, fields)
        wanted = tuple(FUNCTIONS) if ahead else ("command",)
        addresses: dict[str, int] = {}
        held: Any = None
        trouble = ""
        if not UNCOMPILED:
            with _compiling:
                held = _entries(name, digest, home, packed.dtype, state.dtype)
                addresses, trouble = held.addresses(wanted), held.trouble
        if not addresses:
            held = python_functions(home, self._constants, state.dtype, wanted, self.ended)
            addresses = {
                key: ctypes.cast(function, ctypes.c_void_p).value or 0
                for key, function in held.items()
            }
        super().__init__(name, addresses, packed, state, held)
        self.trouble = trouble

    def explain(self, samples: np.ndarray, index: int) -> str:
        """One sentence on what the law did wrong, from running it once more in Python."""
        for i, force in self._in_python(samples):
            where = f"the law {self.name}, at sample {i}"
            if isinstance(force, BaseException):
                return f"{where}, failed: {_said(force)}"
            if not isinstance(force, numbers.Real):
                return f"{where}, returned {force!r}, which is no number"
            if not math.isfinite(force):
                return f"{where}, commanded {float(force)} N"
        return super().explain(samples, index)

    def reads_unknown(self, samples: np.ndarray) -> str:
        """One sentence on a sample that the law reads but is not given, from running it in Python;
        empty if there is none."""
        for i, force in self._in_python(samples):
            if isinstance(force, UnknownSample):
                return f"the law {self.name}, at sample {i}, failed: {_said(force)}"
        return ""

    def _in_python(self, samples: np.ndarray) -> Iterator[tuple[int, Any]]:
        """Every sample with the command, or with what the law raised, which is the last."""
        state = state_view(self.new_state(), self._state.dtype)
        command = uncompiled(self._home.command)
        for i in range(len(samples)):
            try:
                with np.errstate(all="ignore"):  # what comes of it is said elsewhere
                    force = command(self._constants, state, samples[: i + 1].view(Known), i)
            except (Exception, SystemExit) as error:
                yield i, error
                return
            yield i, force

    def cost_us(self, samples: np.ndarray) -> float:
        """What a sample costs, us; measured with samples that it is known to take."""
        state, command = state_view(self.new_state(), self._state.dtype), plain(self._home.command)
        started = time.perf_counter()
        for i in range(len(samples)):
            command(self._constants, state, samples[: i + 1], i)
        return 1e6 * (time.perf_counter() - started) / len(samples)


# By name and digest of the law and by the layouts, which are kept and thus known by identity.
_ENTRIES: dict[tuple[str, str, int, int], tuple[Entries, np.dtype, np.dtype]] = {}
_compiling = Lock()  # threads that meet a new law at once would each compile it, and drop others'


def _entries(name: str, digest: str, home: Any, parameters: np.dtype, state: np.dtype) -> Entries:
    key = (name, digest, id(parameters), id(state))
    if key not in _ENTRIES:
        made = Entries(home, name, digest, parameters, state)
        _ENTRIES[key] = (made, parameters, state)
    return _ENTRIES[key][0]


def _with_arrays(constants: Any, fields: Mapping[str, Any]) -> Any:
    """The constants as Python sees them: numbers, and arrays instead of tuples."""
    arrays = {k: np.asarray(v, float) for k, v in fields.items() if isinstance(v, tuple | list)}
    return constants._replace(**arrays) if arrays else constants


def _said(error: BaseException) -> str:
    """An exception, with its line."""
    trace = traceback.extract_tb(error.__traceback__)
    frames = [frame for frame in trace if frame.filename != Known.__getitem__.__code__.co_filename]
    at = f" (line {frames[-1].lineno}: {frames[-1].line})" if len(frames) > 1 else ""
    return f"{type(error).__name__}: {error}{at}"
