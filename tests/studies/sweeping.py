"""What the tests of sweeps share: a coarse model, the command in a process, waiting for it."""

import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

from hertzloop.studies.sweep.request import SweepRequest
from tests.elastic_scenes import with_elastic_scenes

COARSE = ["run.accuracy=0.05"]
ONE_WORKER = SweepRequest(workers=1)


def command(*words: str) -> list[str]:
    """The words that start a command in a process of its own; a shipped scene is its elastic
    copy."""
    return [sys.executable, "-m", "hertzloop", *with_elastic_scenes(words)]


def wait_until(look: Callable[[], bool], process: subprocess.Popen[Any]) -> None:
    """Wait for what a command that goes on brings about."""
    deadline = time.monotonic() + 120
    while not look():
        assert process.poll() is None, "it ended before it could be cut short"
        assert time.monotonic() < deadline
        time.sleep(0.01)
