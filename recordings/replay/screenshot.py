"""A picture of a replay, drawn by a viewer that needs no screen, and how long its frames take."""

import json
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Literal, TypeVar

import numpy as np
from rerun.experimental import ViewerClient

from bus.reserved import reserved_ports
from recordings.replay.blueprint import TIMELINE
from recordings.replay.viewer import ViewerError, executable, loaded, reason, running

_Answer = TypeVar("_Answer")
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

    def ask(process: subprocess.Popen[bytes], port: int) -> bytes:
        return _settled(loaded(process, port), time_ns)

    picture = _asked(rrd, ask, "draw the picture", size, within_s)
    try:
        png.write_bytes(picture)
    except OSError as error:
        raise ViewerError(f"cannot write {png}: {error.strerror}") from error


def frame_times_ms(
    rrd: Path, time_ns: int, frames: int, state: Literal["paused", "playing"]
) -> list[float]:
    """Time on the viewer's main thread of each of so many frames of SIZE with everything loaded,
    ms; the cursor at `time_ns`, or playing from there on. Raises ViewerError as `screenshot`."""
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        trace = Path(folder) / "frames.puffin"

        def ask(process: subprocess.Popen[bytes], port: int) -> None:
            client = loaded(process, port)
            _settled(client, time_ns)
            client.set_time(TIMELINE, duration=np.timedelta64(time_ns, "ns"), play_state=state)
            client.capture_profile_trace(str(trace), num_frames=frames)

        _asked(rrd, ask, "tell the time of its frames")
        words = [str(executable()), "dump-puffin", str(trace)]
        dumped = subprocess.run(words, capture_output=True, check=False)
    if dumped.returncode:
        raise ViewerError(f"the viewer cannot read its own times (code {dumped.returncode})")
    return [1e-6 * frame["duration_ns"] for frame in json.loads(dumped.stdout)["frames"]]


def _asked(
    rrd: Path,
    ask: Callable[[subprocess.Popen[bytes], int], _Answer],
    to_do: str,
    size: tuple[int, int] = SIZE,
    within_s: float = 90.0,
) -> _Answer:
    """What a viewer without a screen answers, its process and port given; it is gone then."""
    options = ("--headless", "--window-size", f"{size[0]}x{size[1]}")
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
            return ask(process, port)
        except (ConnectionError, RuntimeError, OSError) as error:
            if late.is_set():
                message = f"the viewer did not {to_do} within {within_s:g} s"
                raise ViewerError(message) from error
            raise ViewerError(_failure(process, log, to_do, error)) from error
        finally:
            watchdog.cancel()


def _failure(process: subprocess.Popen[bytes], log: IO[bytes], to_do: str, error: Exception) -> str:
    if isinstance(error, ViewerError):
        return str(error)
    if process.poll() is not None:
        return f"the viewer ended before it could {to_do}; {reason(log)}"
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
