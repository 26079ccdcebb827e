"""What the first commands of a newcomer cost: all kernels are compiled, from an empty cache.

Processor time is that of all processes of a command.
"""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.commands import ROOT, Taken, take
from benchmarks.program import (
    OutDirOption,
    QuickOption,
    RoundsOption,
    median,
    start,
    tracked,
)
from benchmarks.results import results_in
from hertzloop.cli.terminal import fail

_COMMANDS = {
    "run": ["run", "--overwrite", "--out", "first.mcap"],
    "sweep": ["sweep", "--over", "controller.latency_us=0,5", "--overwrite", "--out", "first.csv"],
    "replay": ["replay", "first.mcap", "--save", "first.rrd", "--overwrite"],
}
_QUICK = {"version": ["--version"]}
_SHOWN = 25  # kernels in the table
# Runs each kernel of the default scene in one process. Prints the processor time of each function
# without that of the functions that it calls.
_KERNELS = """
import json, sys, tempfile, time
from collections import Counter
from importlib import import_module
from pathlib import Path
event = import_module("numba.core.event")

class Own(event.Listener):
    running, seconds = [], Counter()
    def on_start(self, event):
        self.running.append([time.process_time(), 0.0])
    def on_end(self, event):
        began, others = self.running.pop()
        taken = time.process_time() - began
        function = event.data["dispatcher"].py_func
        module = function.__module__.removeprefix("hertzloop.")
        self.seconds[f"{module}.{function.__qualname__}"] += taken - others
        if self.running:
            self.running[-1][1] += taken

event.register("numba:compile", Own())
from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.simulate import simulate
from hertzloop.results.metrics import metrics_of
from hertzloop.scene.build import free_series
from hertzloop.scene.setup import load
scene = load("aluminium-20mm", ["controller.law=off", "run.duration_s=0.006"])
with tempfile.TemporaryDirectory() as folder:
    for compiled in (False, True):
        record_in_process(scene, Path(folder, f"{compiled}.mcap"), compiled=compiled)
metrics_of(scene, free_series(scene))
metrics_of(scene, simulate(scene).truth)
print(json.dumps(Own.seconds))
"""


@dataclass(frozen=True)
class First:
    """Wall time and processor time of a command with an empty cache, s; medians of the rounds."""

    command: str
    wall_s: float
    cpu_s: float


def _take(words: list[str], folder: Path) -> Taken:
    """What a command takes with an empty cache."""
    with TemporaryDirectory(prefix="hertzloop-") as cache:
        return take(words, ROOT, folder, {"NUMBA_CACHE_DIR": cache})


def measure(rounds: int, quick: bool) -> list[First]:
    """The first commands, as many rounds."""
    found: dict[str, list[Taken]] = {}
    with TemporaryDirectory(prefix="hertzloop-") as name:
        for _ in tracked("rounds", range(rounds)):
            for command, words in (_QUICK if quick else _COMMANDS).items():
                taken = _take([sys.executable, "-m", "hertzloop", *words], Path(name))
                found.setdefault(command, []).append(taken)
    return [
        First(command, median(one.wall_s for one in some), median(one.cpu_s for one in some))
        for command, some in found.items()
    ]


def kernels() -> dict[str, float]:
    """Processor time of each compiled function of the default scene, s; the longest first.

    Raises:
        subprocess.CalledProcessError: the scene could not be run.
    """
    with TemporaryDirectory(prefix="hertzloop-") as name:
        _take([sys.executable, "-c", _KERNELS], Path(name))
        found: dict[str, float] = json.loads(Path(name, "said.txt").read_text().splitlines()[-1])
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def main(folder: OutDirOption = None, rounds: RoundsOption = 3, quick: QuickOption = False) -> None:
    """Measure the first run, sweep and replay with no compiled kernels, and each kernel.

    Example: python -m benchmarks.first_run --quick
    """
    with results_in(folder, "first_run") as results:
        try:
            first, compiled = measure(1 if quick else rounds, quick), kernels()
        except subprocess.CalledProcessError as error:
            fail(f"a command failed: {error}", 1)
        results.write("first", first)
        results.write_rows("kernels", ("kernel", "cpu_s"), compiled.items())
        results.table(
            "first commands, nothing compiled",
            {
                "command": "{.command}",
                "wall time, s": "{.wall_s:.1f}",
                "processor time, s": "{.cpu_s:.1f}",
            },
            first,
        )
        results.table(
            "processor time to compile a function without those that it calls, s",
            {"function": "{[0]}", "time": "{[1]:.2f}"},
            list(compiled.items())[:_SHOWN],
        )
        results.conclude(
            f"The kernels of the default scene are {len(compiled)} functions, which take "
            f"{sum(compiled.values()):.1f} s of processor time to compile."
        )


if __name__ == "__main__":
    start("benchmarks.first_run")
