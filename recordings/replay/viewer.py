"""The Rerun viewer as a process of its own, listening on loopback only."""

import contextlib
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import IO, TypeVar

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.experimental import ViewerClient

from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import TruthBlock
from hertzloop.bus.sockets import LOOPBACK, reserved_ports
from hertzloop.common.atomic_files import atomic_write
from hertzloop.recordings.replay.blueprint import TIMELINE
from hertzloop.recordings.replay.plots import TITLES
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


# Field of a block, entity, factor: the plots of a live view.
_CURVES = (
    ("xi_m", "live/gap/xi", 1e6),
    ("f_c_n", "live/force/F_c", 1.0),
    ("f_a_n", "live/force/F_a", 1.0),
    ("v_p_m_s", "live/velocity/v_p", 1.0),
)
_PIECES = 4  # of a block at least, each with its minimum and maximum
_PIECE_STEPS = 250  # at most


def live_blueprint() -> rrb.Blueprint:
    """Three plots of the whole run until now."""
    views = [
        rrb.TimeSeriesView(origin=f"live/{key}", name=title)
        for key, title in list(TITLES.items())[:3]
    ]
    return rrb.Blueprint(rrb.Vertical(*views), auto_layout=False, auto_views=False)


def extremes_of(values: np.ndarray) -> np.ndarray:
    """Ascending positions of the minimum and maximum of each piece of a block."""
    pieces = min(max(_PIECES, -(-len(values) // _PIECE_STEPS)), len(values))
    found = [
        part[0] + np.array([values[part].argmin(), values[part].argmax()])
        for part in np.array_split(np.arange(len(values)), pieces)
    ]
    return np.unique(np.concatenate(found))


def send_block(stream: rr.RecordingStream, payload: bytes) -> int:
    """Show some samples of a block of truth; how many. Raises codec.MessageError."""
    block = codec.decode(TruthBlock, payload)
    sent = 0
    for field, entity, factor in _CURVES:
        values = block.arrays[field]
        if not len(values):
            continue
        chosen = extremes_of(values)
        times = (block.header.first_step + chosen) * block.header.step_ns
        stream.send_columns(
            entity,
            [rr.TimeColumn(TIMELINE, duration=times.astype("timedelta64[ns]"))],
            rr.Scalars.columns(scalars=factor * values[chosen]),
        )
        sent += len(chosen)
    return sent


_Answer = TypeVar("_Answer")
SIZE = (1920, 1200)  # pixels
_ALIKE = 3  # pictures in a row
_SETTLES_S = 8.0  # data and meshes arrive after the first pictures
_PAUSE_S = 0.4


def screenshot(
    rrd: Path, png: Path, time_ns: int, size: tuple[int, int] = SIZE, within_s: float = 90.0
) -> None:
    """Draw an .rrd file with the time cursor at `time_ns` and write the picture.

    Raises ViewerError if the viewer does not start, a view reports an error, or the picture is
    not there after `within_s` seconds; and NotWritten.
    """

    def ask(process: subprocess.Popen[bytes], port: int) -> bytes:
        return settled(loaded(process, port), time_ns)

    picture = asked(rrd, ask, "draw the picture", size, within_s)
    atomic_write(png, picture)


def asked(
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


def settled(client: ViewerClient, time_ns: int) -> bytes:
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
