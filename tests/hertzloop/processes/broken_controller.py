"""The example controller, run as a process, with one rule of the bus broken: the first argument."""

import importlib.util
import math
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "own_controller.py"
spec = importlib.util.spec_from_file_location("own_controller", EXAMPLE)
assert spec
assert spec.loader
own = importlib.util.module_from_spec(spec)
spec.loader.exec_module(own)


def at(number: int, change: Callable[[Any], object]) -> Callable[[str, Any], None]:
    """Change the block of forces of a number."""

    def alter(stream: str, message: Any) -> None:
        if stream == "force" and message.sequence == number:
            change(message)

    return alter


def next_bit(message: Any) -> None:
    """Another last bit of the first force that is none."""
    for i, force in enumerate(message.force_n):
        if force:
            message.force_n[i] = math.nextafter(force, math.inf)


def by_its_number(stream: str, message: Any) -> None:
    """Forces that depend on how samples were cut into blocks."""
    if stream == "force":
        for i, force in enumerate(message.force_n):
            message.force_n[i] = force * (1.0 + 1e-3 * message.sequence)


ALTERATIONS: dict[str, Callable[[str, Any], object]] = {
    "gap": at(4, lambda m: setattr(m, "sequence", 6)),
    "next-bit": lambda stream, m: next_bit(m) if stream == "force" else None,
    "by-the-cut": by_its_number,
    "late": at(3, lambda m: time.sleep(30)),
    "dies": at(3, lambda m: os._exit(3)),
    "fault": lambda stream, m: stream == "end/controller" and setattr(m, "fault", "out of force"),
}


class Broken(own.Controller):
    """Breaks a rule in what it says."""

    def __init__(self, say: Callable[[str, Any], None]) -> None:
        def otherwise(stream: str, message: Any) -> None:
            ALTERATIONS.get(rule, lambda stream, message: None)(stream, message)
            if rule == "rubbish" and stream == "force" and message.sequence == 2:
                message = Rubbish(message)
            say(stream, message)

        super().__init__(otherwise)


class Rubbish:
    """A message whose bytes are one of another type."""

    def __init__(self, message: Any) -> None:
        self._bytes = message.SerializeToString() + b"\x50\x01"  # field 10, a number

    def SerializeToString(self) -> bytes:
        return self._bytes


if __name__ == "__main__":
    rule = sys.argv.pop(1)
    own.Controller = Broken
    own.main()
    if rule == "exit-code":
        sys.exit(4)
