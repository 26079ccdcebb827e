"""Events of a run, derived from streams block by block.

They depend on samples only, never on how a stream was cut into blocks.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log

from hertzloop.bus.events import event
from hertzloop.bus.messages_pb2 import Event, EventKind
from hertzloop.controller.law import ACTING, IDLE
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.setup import Setup

MOST = 10_000  # events of one publisher that are listed


def _changes(flags: np.ndarray, before: bool) -> np.ndarray:
    """Positions at which a boolean array changes, given the value before it."""
    return np.flatnonzero(np.diff(flags.astype(np.int8), prepend=np.int8(before)))


StepEvent = tuple[int, Any, dict[str, Any]]  # step, level, fields of the message


class _LimitedEvents:
    """Passes on the first MOST events of a publisher, and counts the others.

    The last event of a run states their number.
    """

    def __init__(self, name: str, setup: Setup) -> None:
        self._name, self._steps, self._step_ns = name, setup.run.steps, setup.run.step_ns
        self._every = setup.sensor.every_steps
        self._found = 0

    def _published(self, found: Iterable[StepEvent], end: int) -> Iterator[Event]:
        """Pass on the events of a block that ends before step `end`, by rising step."""
        for step, level, fields in found:
            self._found += 1
            if self._found <= MOST:
                yield event(self._name, step, self._step_ns, level, **fields)
        if end >= self._steps and self._found > MOST:
            message = f"{self._found - MOST:,} further events are not listed"
            self._found = 0
            yield event(self._name, self._steps - 1, self._step_ns, Log.WARNING, message=message)


class PlantEvents(_LimitedEvents):
    """Contacts, and saturation of the converter."""

    def __init__(self, setup: Setup) -> None:
        super().__init__("plant", setup)
        self._quantity = setup.scene.sensors.quantity
        self._touching = self._clipped = False
        self._contacts = 0

    def of(
        self,
        first_step: int,
        gap: np.ndarray,
        first_sample: int,
        clipped: np.ndarray,
    ) -> Iterator[Event]:
        """Yield the events of a block in the order of their steps.

        Args:
            first_step: First step of the block.
            gap: Gap above the permanent indentation, m, one a step.
            first_sample: First sample of the block.
            clipped: Whether the converter was saturated, one a sample.
        """
        touching = gap < 0.0
        found: list[StepEvent] = []
        for i in _changes(touching, self._touching):
            self._contacts += int(touching[i])
            kind = EventKind.CONTACT_BEGAN if touching[i] else EventKind.CONTACT_ENDED
            fields = {"kind": kind, "number": self._contacts}
            found.append((first_step + int(i), Log.INFO, fields))
        flags = clipped.astype(bool)
        for i in _changes(flags, self._clipped):
            kind = EventKind.RANGE_LEFT if flags[i] else EventKind.RANGE_REGAINED
            level = Log.WARNING if flags[i] else Log.INFO
            step = (first_sample + int(i)) * self._every
            found.append((step, level, {"kind": kind, "quantity": self._quantity}))
        self._touching = bool(touching[-1]) if len(touching) else self._touching
        self._clipped = bool(flags[-1]) if len(flags) else self._clipped
        found.sort(key=lambda one: one[0])
        yield from self._published(found, first_step + len(touching))


class ControllerEvents(_LimitedEvents):
    """Changes of the law's mode, with the delay that was latched at the threshold."""

    def __init__(self, setup: Setup) -> None:
        super().__init__("controller", setup)
        self._latches = loaded_law(setup).latches
        self._mode = IDLE

    def of(self, first_sample: int, modes: np.ndarray, delays: np.ndarray) -> Iterator[Event]:
        """Yield the events of a block of samples."""
        end = (first_sample + len(modes)) * self._every
        yield from self._published(self._of_modes(first_sample, modes, delays), end)

    def _of_modes(
        self, first_sample: int, modes: np.ndarray, delays: np.ndarray
    ) -> Iterator[StepEvent]:
        for i in np.flatnonzero(np.diff(modes, prepend=self._mode)):
            old, self._mode = self._mode, int(modes[i])
            fields: dict[str, Any] = {"mode_before": old, "mode": self._mode}
            if self._mode == ACTING and self._latches:
                fields["delay_ns"] = int(delays[i]) * self._every * self._step_ns
            step = (first_sample + int(i)) * self._every
            yield step, Log.INFO, {"kind": EventKind.LAW_MODE, **fields}
