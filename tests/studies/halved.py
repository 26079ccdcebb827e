"""A worker of a sweep that does not get to the end of an answer."""

import os
import signal
import struct
import sys
import time
from types import FrameType
from typing import Any


def half_an_answer(toml: str, how: str, numbered: Any) -> None:
    """Tell how long the answer is, no more; then die, or interrupt the sweep and hang."""
    frame: FrameType | None = sys._getframe()
    while frame is not None and "result_queue" not in frame.f_locals:
        frame = frame.f_back
    assert frame is not None
    os.write(frame.f_locals["result_queue"]._writer.fileno(), struct.pack("!i", 10_000))
    if how == "dies":
        os._exit(1)
    os.kill(os.getppid(), signal.SIGINT)
    time.sleep(600)
