"""The Rerun viewer as a process of its own, listening on loopback only."""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import IO

import numpy as np
from rerun.experimental import ViewerClient

from hertzloop.bus.sockets import LOOPBACK, reserved_ports
from hertzloop.recordings.replay.blueprint import TIMELINE
from hertzloop.recordings.writer import RecordingError

_STOPPING_TAKES_S = 5.0
_ASK_EVERY_S = 0.3
_NO_GRAPHICS = ("No graphics adapter was found", "Failed to get render context")


class ViewerError(RecordingError):
    """The viewer cannot be started or does not do what it is asked; the sentence says why."""


def executable() -> Path:
    """The viewer that comes with rerun-sdk. Raises ViewerError if it is not there."""
    # Not the `rerun` command: that is a script with the viewer as a child, which outlives it.
    folder = Path(str(resources.files("rerun_cli")))
    bundle = folder / "Rerun.app" / "Contents" / "MacOS" / "Rerun"
    found = bundle if bundle.exists() else folder / f"rerun{'.exe' if os.name == 'nt' else ''}"
    if not found.exists():
        raise ViewerError(f"the viewer {found} is missing; install rerun-sdk again")
    return found


@contextlib.contextmanager
def running(rrd: Path, *options: str) -> Iterator[tuple[subprocess.Popen[bytes], IO[bytes]]]:
    """The viewer with a file, as process and its log; it is gone when the context ends."""
    command = [str(executable()), str(rrd), "--bind", LOOPBACK, *options]
    with tempfile.TemporaryFile() as log:
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=os.environ | {"RERUN_APP_ONLY": "true"},
            )
        except OSError as error:
            raise ViewerError(f"cannot start the viewer {command[0]}: {error.strerror}") from error
        try:
            yield process, log
        finally:
            process.terminate()
            try:
                process.wait(_STOPPING_TAKES_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def reason(log: IO[bytes]) -> str:
    """Why a viewer ended, from its log, in one sentence."""
    log.seek(0)
    text = log.read().decode(errors="replace")
    if any(words in text for words in _NO_GRAPHICS):
        return (
            "it found no graphics driver; without a graphics card it needs a software one "
            "(on Debian and Ubuntu: apt install mesa-vulkan-drivers libvulkan1)"
        )
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    telling = [line for line in lines if "panicked" in line or "rror" in line] or lines
    return f"its log ends: {telling[-1]}" if telling else "it said nothing"


def has_display() -> bool:
    """Whether a window could be opened."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def show(rrd: Path, time_ns: int) -> None:
    """Open a window with the cursor at `time_ns` and wait until somebody closes it.

    Raises ViewerError if the viewer fails.
    """
    with (
        reserved_ports(1) as [port],
        running(rrd, "--port", str(port)) as (process, log),
    ):
        # A file cannot say where the cursor starts (0.41), and a cursor left of the time
        # selection does not jump to it.
        with contextlib.suppress(ConnectionError, RuntimeError):
            loaded(process, port).set_time(TIMELINE, duration=np.timedelta64(time_ns, "ns"))
        if process.wait() != 0:
            raise ViewerError(f"the viewer ended with code {process.returncode}; {reason(log)}")


def loaded(process: subprocess.Popen[bytes], port: int) -> ViewerClient:
    """A client of a viewer, once that has loaded its file.

    Raises ConnectionError or RuntimeError if the viewer ends before.
    """
    while True:
        try:
            client = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
            state = client.get_state()
            if state.recordings and not state.loading:
                return client
        except ConnectionError:
            if process.poll() is not None:
                raise
        time.sleep(_ASK_EVERY_S)
