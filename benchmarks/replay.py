"""How long a recording takes to the file of the viewer."""

import statistics
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.program import OutDirOption, QuickOption, RoundsOption, start, tracked
from benchmarks.results import results_in
from benchmarks.scenes import load
from hertzloop.cli.options import JsonOption
from hertzloop.loop.in_process import record_in_process
from hertzloop.recordings.reader import read
from hertzloop.recordings.replay import as_rerun
from hertzloop.views import replaying


@dataclass(frozen=True)
class ReplayCost:
    """Wall time and processor time (s), medians, from a recording of so many steps, the run without
    control simulated beside it, to an .rrd file of so many MB, without the start of Python."""

    steps: int
    wall_s: float
    cpu_s: float
    megabytes: float


def measure(rounds: int, duration_s: float = 0.6) -> ReplayCost:
    """Costs of the scene `aluminium-3mm` of this length."""
    setup = load("aluminium-3mm", [f"run.duration_s={duration_s}"])
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        file, rrd = Path(folder) / "run.mcap", Path(folder) / "run.rrd"
        record_in_process(setup, file, compiled=True)
        _convert(file, rrd)  # loads what is compiled
        times = [_convert(file, rrd) for _ in tracked("to an .rrd file", range(rounds))]
        megabytes = 1e-6 * rrd.stat().st_size
    wall_s, cpu_s = (statistics.median(column) for column in zip(*times, strict=True))
    return ReplayCost(setup.run.steps, wall_s, cpu_s, megabytes)


def _convert(file: Path, rrd: Path) -> tuple[float, float]:
    """Seconds on the wall and of processor time."""
    wall, spent = time.perf_counter(), time.process_time()
    as_rerun.save(replaying.prepare(read(file)), rrd)
    return time.perf_counter() - wall, time.process_time() - spent


_QUICK_S = 0.0016


def main(
    folder: OutDirOption = None,
    rounds: RoundsOption = 7,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Measure how long a recording of 600 000 steps takes to the file of the viewer.

    With --quick the recording has 1600 steps.

    Example: python -m benchmarks.replay --quick
    """
    with results_in(folder, "replay", "modal", json_file=json_file) as results:
        found = measure(1, _QUICK_S) if quick else measure(rounds)
        results.write("replay", [found])
        results.table(
            f"replay of {found.steps:,} steps",
            {"time, s": "{.wall_s:.3g}", "processor time, s": "{.cpu_s:.3g}"},
            [found],
            text=0,
        )
        results.conclude(
            f"A recording of {found.steps:,} steps becomes an .rrd file of {found.megabytes:.1f} "
            f"MB in {found.wall_s:.2f} s."
        )


if __name__ == "__main__":
    start("benchmarks.replay")
