"""A picture of an .rrd file, drawn by a viewer without a screen."""

import subprocess
import threading
import time
from pathlib import Path
from typing import IO

import numpy as np
from rerun.experimental import ViewerClient

from hertzloop.bus.sockets import reserved_ports
from hertzloop.common.atomic_files import atomic_write
from hertzloop.recordings.replay.blueprint import TIMELINE
from hertzloop.recordings.replay.viewer import ViewerError, loaded, reason, running

SIZE = (1920, 1200)  # pixels
_ALIKE = 3  # pictures in a row
_SETTLES_S = 8.0  # data and meshes arrive after the first pictures
_PAUSE_S = 0.4


def screenshot(rrd: Path, png: Path, time_ns: int, within_s: float = 90.0) -> None:
    """Draw an .rrd file with the time cursor at `time_ns` and write the picture.

    Raises ViewerError if the viewer does not start, a view reports an error, or the picture is
    not there after `within_s` seconds; and NotWritten.
    """
    options = ("--headless", "--window-size", f"{SIZE[0]}x{SIZE[1]}")
    with (
        reserved_ports(1) as [port],
        running(rrd, *options, "--port", str(port)) as (process, log),
    ):
        late = threading.Event()

        def give_up() -> None:
            late.set()
            process.kill()  # frees whoever waits for an answer

        watchdog = threading.Timer(within_s, give_up)
        watchdog.daemon = True
        watchdog.start()
        try:
            picture = _settled(loaded(process, port), time_ns)
        except (ConnectionError, RuntimeError, OSError) as error:
            if late.is_set():
                message = f"the viewer did not draw the picture within {within_s:g} s"
                raise ViewerError(message) from error
            raise ViewerError(_failure(process, log, error)) from error
        finally:
            watchdog.cancel()
    atomic_write(png, picture)


def _failure(process: subprocess.Popen[bytes], log: IO[bytes], error: Exception) -> str:
    if isinstance(error, ViewerError):
        return str(error)
    if process.poll() is not None:
        return f"the viewer ended before it could draw the picture; {reason(log)}"
    return f"the viewer did not answer: {error}"


def _settled(client: ViewerClient, time_ns: int) -> bytes:
    """The picture as PNG, once it no longer changes."""
    client.set_time(TIMELINE, duration=np.timedelta64(time_ns, "ns"), play_state="paused")
    begun, pictures = time.monotonic(), [b""]
    while len(pictures) < _ALIKE or time.monotonic() - begun < _SETTLES_S:
        picture = client.take_screenshot()
        pictures = [*pictures, picture] if picture == pictures[-1] else [picture]
        time.sleep(_PAUSE_S)
    for view in client.get_state().views:
        for report in view.reports:
            if report.severity == "error":
                raise ViewerError(f"the view '{view.name}' cannot be drawn: {report.summary}")
    return pictures[-1]
