"""What a replay costs: the way from a recording to a file of the viewer, and a frame there."""

import statistics
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from hertzloop.loop.compiled import record_in_process
from hertzloop.setup import load
from hertzloop.views import replaying
from recordings.reader import read
from recordings.replay import as_rerun
from recordings.replay.viewer import ViewerError, frame_times_ms

_FRAMES = 40
_STATES: tuple[Literal["paused", "playing"], ...] = ("paused", "playing")


@dataclass(frozen=True)
class Measured:
    """Median and least of what was measured several times."""

    case: str
    median: float
    least: float


@dataclass(frozen=True)
class ReplayCost:
    """`cases`: from a recording of so many steps, the run without control simulated beside it, to
    an .rrd file of so many MB, without the start of Python; a frame of the whole dashboard. Why
    frames are not known, if they are not."""

    steps: int
    cases: list[Measured]
    megabytes: float
    no_frames: str = ""


def measure(rounds: int, duration_s: float = 0.6) -> ReplayCost:
    """Costs of the scene `aluminium-3mm` of this length."""
    setup = load("aluminium-3mm", [f"run.duration_s={duration_s}"])
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        file, rrd = Path(folder) / "run.mcap", Path(folder) / "run.rrd"
        record_in_process(setup, file, compiled=True)
        found: dict[str, list[float]] = {"to an .rrd file, s": [], "... of processor time, s": []}
        cursor_ns = _convert(file, rrd, ([], []))  # loads what is compiled
        for _ in range(rounds):
            _convert(file, rrd, tuple(found.values()))
        why = ""
        try:
            for state in _STATES:
                case = f"a frame of the viewer, {state}, ms"
                found[case] = frame_times_ms(rrd, cursor_ns, _FRAMES, state)
        except ViewerError as error:
            why = str(error)
        megabytes = 1e-6 * rrd.stat().st_size
    cases = [Measured(c, statistics.median(times), min(times)) for c, times in found.items()]
    return ReplayCost(setup.steps, cases, megabytes, why)


def _convert(file: Path, rrd: Path, times: tuple[list[float], ...]) -> int:
    """Appends seconds on the wall and of processor time; the time of a still picture, ns."""
    wall, spent = time.perf_counter(), time.process_time()
    shown = replaying.prepare(read(file, keep=True))
    as_rerun.save(shown, rrd)
    times[0].append(time.perf_counter() - wall)
    times[1].append(time.process_time() - spent)
    return shown.when.still_ns
