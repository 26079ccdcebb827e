"""How long the way from a recording to the viewer takes, and a frame there."""

import json
import statistics
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from benchmarks.program import OutDirOption, QuickOption, RoundsOption, start, tracked
from benchmarks.results import results_in
from hertzloop.cli.options import JsonOption
from hertzloop.cli.terminal import out
from hertzloop.loop.in_process import record_in_process
from hertzloop.recordings.reader import read
from hertzloop.recordings.replay import as_rerun, viewer
from hertzloop.scene.setup import load
from hertzloop.views import replaying

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


def frame_times_ms(
    rrd: Path, time_ns: int, frames: int, state: Literal["paused", "playing"]
) -> list[float]:
    """Time on the viewer's main thread of each of so many frames with everything loaded, ms; the
    cursor at `time_ns`, or playing from there on. Raises ViewerError as `viewer.screenshot`."""
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        trace = Path(folder) / "frames.puffin"

        def ask(process: subprocess.Popen[bytes], port: int) -> None:
            client = viewer.loaded(process, port)
            viewer.settled(client, time_ns)
            client.set_time(
                viewer.TIMELINE, duration=np.timedelta64(time_ns, "ns"), play_state=state
            )
            client.capture_profile_trace(str(trace), num_frames=frames)

        viewer.asked(rrd, ask, "tell the time of its frames")
        words = [str(viewer.executable()), "dump-puffin", str(trace)]
        dumped = subprocess.run(words, capture_output=True, check=False)
    if dumped.returncode:
        raise viewer.ViewerError(f"the viewer cannot read its own times (code {dumped.returncode})")
    return [1e-6 * frame["duration_ns"] for frame in json.loads(dumped.stdout)["frames"]]


def measure(rounds: int, duration_s: float = 0.6) -> ReplayCost:
    """Costs of the scene `aluminium-3mm` of this length."""
    setup = load("aluminium-3mm", [f"run.duration_s={duration_s}"])
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        file, rrd = Path(folder) / "run.mcap", Path(folder) / "run.rrd"
        record_in_process(setup, file, compiled=True)
        found: dict[str, list[float]] = {"to an .rrd file, s": [], "... of processor time, s": []}
        cursor_ns = _convert(file, rrd, ([], []))  # loads what is compiled
        for _ in tracked("to an .rrd file", range(rounds)):
            _convert(file, rrd, tuple(found.values()))
        why = ""
        try:
            for state in _STATES:
                case = f"a frame of the viewer, {state}, ms"
                found[case] = frame_times_ms(rrd, cursor_ns, _FRAMES, state)
        except viewer.ViewerError as error:
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


_QUICK_S = 0.0016


def main(
    folder: OutDirOption = None,
    rounds: RoundsOption = 7,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Measure how long a recording of 600 000 steps takes to the viewer, and a frame there.

    With --quick the recording has 1600 steps.

    Example: python -m benchmarks.replay --quick
    """
    with results_in(folder, "replay", "modal", json_file=json_file) as results:
        found = measure(1, _QUICK_S) if quick else measure(rounds)
        results.write("replay", found.cases)
        results.table(
            f"replay of {found.steps:,} steps",
            {"case": "{.case}", "median": "{.median:.3g}", "least": "{.least:.3g}"},
            found.cases,
        )
        out.print(f"the file has {found.megabytes:.1f} MB")
        if found.no_frames:
            out.say(f"frames not measured: {found.no_frames}")
        results.conclude(
            f"A recording of {found.steps:,} steps becomes an .rrd file of {found.megabytes:.1f} "
            f"MB in {found.cases[0].median:.2f} s."
        )


if __name__ == "__main__":
    start("benchmarks.replay")
