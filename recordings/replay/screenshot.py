"""A picture of a replay, drawn by a viewer that needs no screen."""

import subprocess
import threading
import time
from pathlib import Path
from typing import IO

import numpy as np

from bus.reserved import reserved_ports
from recordings.replay.blueprint import TIMELINE
from recordings.replay.viewer import ViewerError, loaded, reason, running

SIZE = (1920, 1200)  # pixels
_ALIKE = 3  # pictures in a row
_SETTLES_S = 8.0  # data and meshes arrive after the first pictures
_PAUSE_S = 0.4


def screenshot(
    rrd: Path, png: Path, time_ns: int, size: tuple[int, int] = SIZE, within_s: float = 90.0
) -> None:
    """Draw an .rrd file with the time cursor at `time_ns` and write the picture.

    Raises ViewerError if the viewer does not start, a view reports an error, the picture is
    not there after `within_s` seconds, or cannot be written.
    """
    size_option = f"{size[0]}x{size[1]}"
    options = ("--headless", "--window-size", size_option)
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
            picture = _picture(process, port, time_ns)
        except (ConnectionError, RuntimeError, OSError) as error:
            if late.is_set():
                message = f"the viewer did not draw the picture within {within_s:g} s"
                raise ViewerError(message) from error
            raise ViewerError(_failure(process, log, error)) from error
        finally:
            watchdog.cancel()
    try:
        png.write_bytes(picture)
    except OSError as error:
        raise ViewerError(f"cannot write {png}: {error.strerror}") from error


def _failure(process: subprocess.Popen[bytes], log: IO[bytes], error: Exception) -> str:
    if isinstance(error, ViewerError):
        return str(error)
    if process.poll() is not None:
        return f"the viewer ended before the picture was drawn; {reason(log)}"
    return f"the viewer did not answer: {error}"


def _picture(process: subprocess.Popen[bytes], port: int, time_ns: int) -> bytes:
    """The picture as PNG, once it no longer changes."""
    client = loaded(process, port)
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
