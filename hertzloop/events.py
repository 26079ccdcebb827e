"""Events of a run as foxglove.Log messages, derived from streams block by block.

They depend on samples only, never on how a stream was cut into blocks.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log

from controller.controller import Mode
from hertzloop.scene import Scene
from sensors.acquisition import Quantity

# Laws that latch a delay when the slope crosses the threshold.
LATCHING = {"slope_threshold", "least_squares", "shifted_threshold", "predicted", "fade_out"}


def log(name: str, step: int, step_ns: int, text: str, level: Any = Log.INFO) -> Log:
    """An event of publisher `name` at a simulated step."""
    message = Log(level=level, name=name, message=text)
    message.timestamp.FromNanoseconds(step * step_ns)
    return message


def _changes(flags: np.ndarray, before: bool) -> np.ndarray:
    """Positions at which a boolean array changes, given the value before it."""
    return np.flatnonzero(np.diff(flags.astype(np.int8), prepend=np.int8(before)))


class PlantEvents:
    """Contacts and saturation, from truth and converter flags of the same steps."""

    def __init__(self, step_ns: int, every_steps: int, quantity: Quantity) -> None:
        self._step_ns, self._every, self._quantity = step_ns, every_steps, quantity
        self._touching = self._clipped = False
        self._contacts = 0

    def of(
        self, first_step: int, xi: np.ndarray, first_sample: int, clipped: np.ndarray
    ) -> Iterator[Log]:
        """Events of a block by rising step."""
        touching = xi < 0.0
        found: list[tuple[int, str, Any]] = []
        for i in _changes(touching, self._touching):
            self._contacts += int(touching[i])
            text = "began" if touching[i] else "ended"
            found.append((first_step + int(i), f"contact {self._contacts} {text}", Log.INFO))
        flags = clipped.astype(bool)
        for i in _changes(flags, self._clipped):
            text = "left the converter's range" if flags[i] else "is back in the converter's range"
            level = Log.WARNING if flags[i] else Log.INFO
            step = (first_sample + int(i)) * self._every
            found.append((step, f"{self._quantity.name.lower()} {text}", level))
        self._touching = bool(touching[-1]) if len(touching) else self._touching
        self._clipped = bool(flags[-1]) if len(flags) else self._clipped
        for step, text, level in sorted(found, key=lambda event: event[0]):
            yield log("plant", step, self._step_ns, text, level)


class ControllerEvents:
    """Changes of the law's mode, with the delay that a threshold latched."""

    def __init__(self, scene: Scene) -> None:
        self._step_ns, self._every = scene.run.step_ns, scene.sensors.every_steps
        self._latches = scene.controller.law in LATCHING
        self._mode = int(Mode.IDLE)

    def of(self, first_sample: int, modes: np.ndarray, delays: np.ndarray) -> Iterator[Log]:
        """Events of a block of samples."""
        changed = np.flatnonzero(np.diff(modes, prepend=self._mode))
        for i in changed:
            old, new = Mode(self._mode), Mode(int(modes[i]))
            self._mode = int(new)
            text = f"law {old.name.lower()} -> {new.name.lower()}"
            if new is Mode.ACTING and self._latches:
                delay_us = delays[i] * self._every * self._step_ns / 1000
                text += f", threshold crossed, delay {delay_us:g} us"
            yield log("controller", (first_sample + int(i)) * self._every, self._step_ns, text)
