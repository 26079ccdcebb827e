"""A law with its constants, ready to be called by the compiled loop."""

import math
import numbers
import time
import traceback
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from hertzloop.common.uncompiled import plain
from hertzloop.controller import law_kernels as laws
from hertzloop.controller.law_kernels import LawModel
from hertzloop.controller.loading import callbacks
from hertzloop.controller.loading import compiled as law_code
from hertzloop.controller.loading.records import PackedRecord, pack, seen_values, state_of


class LawFault(RuntimeError):
    """A law failed in a run; the sentence names it, the sample and what it did."""

    exit_status = 1


class BrokenPromise(LawFault):
    """A command is not the one known ahead, or a force against the promise of none."""


class BoundLaw:
    """A law's functions, the bytes of its constants, and its `state` at the start.

    `trouble`: why it runs as Python, empty if it is compiled; `ended`: what was raised in the law
    that is to end more than the law, as Ctrl-C is, a list that its callbacks `held` may share.
    """

    def __init__(
        self,
        name: str,
        addresses: Mapping[str, int],
        constants: PackedRecord,
        state: PackedRecord,
        held: Any,
        ended: list[BaseException],
    ) -> None:
        self.name, self.trouble, self.ended = name, "", ended
        at: list[Any] = [addresses.get(function, 0) for function in law_code.FUNCTIONS]
        # pyrefly: ignore[bad-argument-type]
        self.model = LawModel(*[*at, constants.data])
        self.state, self._held = state, (constants, held)

    @cached_property
    def waits_above(self) -> float:
        """Level above which samples leave the law at zero, as it is at the start; inf without."""
        return float(laws.trigger_level(self.model, laws.first_state(self.state.data, 0)))

    def explain(self, samples: np.ndarray, index: int) -> str:
        """One sentence on what the law did wrong at sample `index`."""
        return f"the law {self.name} gave no finite number as the command of sample {index}"

    def explain_promise(self, state: laws.LawState) -> str:
        """What the law promised and what it commanded instead, and what to do."""
        index = int(state.counts[laws.FAULT]) - 1
        promised, force_n = (float(state.numbers[at]) for at in (laws.PROMISED, laws.COMMAND))
        said = f"the law {self.name}, at sample {index}, commanded {force_n} N"
        if state.counts[laws.CAUSE] == laws.OTHER_THAN_AHEAD:
            return (
                f"{said}, but its command_ahead had said {promised} N. Count in known_ahead only "
                "commands that do not depend on later samples."
            )
        return (
            f"{said}, but its trigger_level had promised no force while samples stay above "
            f"{promised}, and this one is {float(state.history[index])}. Return NO_TRIGGER from "
            "trigger_level where a force may follow."
        )

    def reads_unknown(self, samples: np.ndarray) -> str:
        """One sentence on a sample that the law reads but is not given, as far as its text can
        tell; empty if there is none."""
        return ""


class BoundPython(BoundLaw):
    """The same of a `Law` written in Python; `constants` are what it sees as `p`.

    With `ahead` false it has `command` alone: what it knows of later samples is not asked for.
    """

    def __init__(self, law: Any, constants: Any, ahead: bool = True) -> None:
        home, seen = law.home, seen_values(constants._asdict())
        packed, state = pack(seen), state_of(home)
        self._home, self._constants = home, constants._replace(**seen)
        wanted = tuple(law_code.FUNCTIONS) if ahead else ("command",)
        addresses: dict[str, int] = {}
        held: Any = None
        trouble, ended = "", list[BaseException]()
        if not law_code.UNCOMPILED:
            held, addresses = law_code.compiled_law(law, packed.dtype, state.dtype, wanted)
            trouble = held.trouble
        if not addresses:
            held = callbacks.python_functions(home, self._constants, state.dtype, wanted, ended)
            addresses = callbacks.addresses_of(held)
        super().__init__(law.name, addresses, packed, state, held, ended)
        self.trouble = trouble

    def explain(self, samples: np.ndarray, index: int) -> str:
        """One sentence on what the law did wrong, from running it once more in Python."""
        for i, force in self._in_python(samples):
            where = f"the law {self.name}, at sample {i}"
            if isinstance(force, BaseException):
                return f"{where}, failed: {_said(force, self._file)}"
            if not isinstance(force, numbers.Real):
                return (
                    f"{where}, returned {force!r}, which is not a number. Return one on every path."
                )
            if not math.isfinite(force):
                return f"{where}, commanded {float(force)} N"
        return super().explain(samples, index)

    def reads_unknown(self, samples: np.ndarray) -> str:
        """One sentence on a sample that the law reads but is not given, from running it in Python;
        empty if there is none."""
        for i, force in self._in_python(samples):
            if isinstance(force, callbacks.UnknownSample):
                return f"the law {self.name}, at sample {i}, failed: {_said(force, self._file)}"
        return ""

    @property
    def _file(self) -> str:
        """The file of its `command`."""
        return str(plain(self._home.command).__code__.co_filename)

    def _in_python(self, samples: np.ndarray) -> Iterator[tuple[int, Any]]:
        """Every sample with the command, or with what the law raised, which is the last."""
        state = callbacks.state_view(self.state.data.copy(), self.state.dtype)
        command = callbacks.uncompiled(self._home.command)
        for i in range(len(samples)):
            try:
                with np.errstate(all="ignore"):  # what comes of it is said elsewhere
                    force = command(
                        self._constants, state, samples[: i + 1].view(callbacks.KnownSamples), i
                    )
            except (Exception, SystemExit) as error:
                yield i, error
                return
            yield i, force

    def cost_us(self, samples: np.ndarray) -> float:
        """What a sample costs, us; measured with samples that it is known to take."""
        state = callbacks.state_view(self.state.data.copy(), self.state.dtype)
        command = plain(self._home.command)
        started = time.perf_counter()
        for i in range(len(samples)):
            command(self._constants, state, samples[: i + 1], i)
        return 1e6 * (time.perf_counter() - started) / len(samples)


def _said(error: BaseException, file: str) -> str:
    """An exception, with the line of the law's file at which it came up."""
    trace = traceback.extract_tb(error.__traceback__)
    frames = [frame for frame in trace if frame.filename == file]
    at = f" (line {frames[-1].lineno}: {frames[-1].line})" if frames else ""
    return f"{type(error).__name__}: {error}{at}"
