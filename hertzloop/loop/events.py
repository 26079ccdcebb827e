"""Events of a run as foxglove.Log messages, derived from streams block by block.

They depend on samples only, never on how a stream was cut into blocks.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log

from controller.law import ACTING, IDLE, MODES
from hertzloop.setup import Setup

_SPAN = 1000  # steps


def log(name: str, step: int, step_ns: int, text: str, level: Any = Log.INFO) -> Log:
    """An event of publisher `name` at a simulated step."""
    message = Log(level=level, name=name, message=text)
    message.timestamp.FromNanoseconds(step * step_ns)
    return message


def _changes(flags: np.ndarray, before: bool) -> np.ndarray:
    """Positions at which a boolean array changes, given the value before it."""
    return np.flatnonzero(np.diff(flags.astype(np.int8), prepend=np.int8(before)))


Found = tuple[int, str, Any]  # step, words, level


class LateForces:
    """Numbers the forces that had not come when their step was taken: one event for all late ones
    of _SPAN steps, at the last of these."""

    def __init__(self, steps: int) -> None:
        """Of a run of so many steps."""
        self._steps, self._numbered = steps, 0
        self._span = np.empty(0, np.int32)  # of the present one, until now

    def of(self, first_step: int, held: np.ndarray) -> Iterator[Found]:
        """Events of a block; `held`: by how many steps each command was too old."""
        first, held = first_step - len(self._span), np.concatenate([self._span, held])
        while len(held) and len(held) >= (length := min(_SPAN, self._steps - first)):
            if np.any(held[:length]):
                yield self._event(first, held[:length])
            first, held = first + length, held[length:]
        self._span = held

    def _event(self, first: int, held: np.ndarray) -> Found:
        late = np.flatnonzero(held)
        number, self._numbered = self._numbered + 1, self._numbered + len(late)
        last = first + len(held) - 1
        if len(late) == 1:
            step = first + int(late[0])
            acted = step - int(held[late[0]])
            text = f"late force {number}: the force of step {acted} acted in step {step}"
            return last, text, Log.WARNING
        rows = np.split(late, np.flatnonzero(np.diff(late) > 1) + 1)
        text = (
            f"late forces {number} to {self._numbered}: in {len(late)} of steps {first} to {last}, "
            f"older ones acted in {len(rows)} rows of at most {max(map(len, rows))} steps, the "
            f"oldest {int(np.max(held))} steps old"
        )
        return last, text, Log.WARNING


class PlantEvents:
    """Contacts and saturation, from truth and converter flags of the same steps, and late forces of
    a run of so many `steps`."""

    def __init__(self, step_ns: int, every_steps: int, quantity: str, steps: int = 0) -> None:
        self._step_ns, self._every, self._quantity = step_ns, every_steps, quantity
        self._late = LateForces(steps)
        self._touching = self._clipped = False
        self._contacts = 0

    def of(
        self,
        first_step: int,
        gap: np.ndarray,
        first_sample: int,
        clipped: np.ndarray,
        held: np.ndarray | None = None,
    ) -> Iterator[Log]:
        """Events of a block by rising step; `gap` above the dent that there is, m; `held` as in
        LateForces."""
        touching = gap < 0.0
        found: list[Found] = []
        for i in _changes(touching, self._touching):
            self._contacts += int(touching[i])
            text = "began" if touching[i] else "ended"
            found.append((first_step + int(i), f"contact {self._contacts} {text}", Log.INFO))
        flags = clipped.astype(bool)
        for i in _changes(flags, self._clipped):
            text = "left the converter's range" if flags[i] else "is back in the converter's range"
            level = Log.WARNING if flags[i] else Log.INFO
            step = (first_sample + int(i)) * self._every
            found.append((step, f"{self._quantity} {text}", level))
        self._touching = bool(touching[-1]) if len(touching) else self._touching
        self._clipped = bool(flags[-1]) if len(flags) else self._clipped
        if held is not None:
            found += self._late.of(first_step, held)
        for step, text, level in sorted(found, key=lambda event: event[0]):
            yield log("plant", step, self._step_ns, text, level)


class ControllerEvents:
    """Changes of the law's mode, with the delay that a threshold latched."""

    def __init__(self, setup: Setup) -> None:
        self._step_ns, self._every = setup.step_ns, setup.every_steps
        self._latches = setup.law.latches
        self._mode = IDLE

    def of(self, first_sample: int, modes: np.ndarray, delays: np.ndarray) -> Iterator[Log]:
        """Events of a block of samples."""
        changed = np.flatnonzero(np.diff(modes, prepend=self._mode))
        for i in changed:
            old, self._mode = self._mode, int(modes[i])
            text = f"law {_name(old)} -> {_name(self._mode)}"
            if self._mode == ACTING and self._latches:
                delay_us = delays[i] * self._every * self._step_ns / 1000
                text += f", threshold crossed, delay {delay_us:g} us"
            yield log("controller", (first_sample + int(i)) * self._every, self._step_ns, text)


def _name(mode: int) -> str:
    """A mode in words; a law may have more than those that have a name."""
    return MODES[mode] if 0 <= mode < len(MODES) else f"mode {mode}"
