"""A worker of a sweep that does not get to the end of an answer."""

import os
import struct
import sys
from types import FrameType
from typing import Any


def half_an_answer(toml: str, span: str, numbered: Any) -> None:
    """Tell how long the answer is, no more; then die."""
    frame: FrameType | None = sys._getframe()
    while frame is not None and "result_queue" not in frame.f_locals:
        frame = frame.f_back
    os.write(frame.f_locals["result_queue"]._writer.fileno(), struct.pack("!i", 10_000))
    os._exit(1)
