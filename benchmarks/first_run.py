"""What the first commands of a newcomer cost: all kernels are compiled, from an empty cache.

With another checkout, each command of both is measured in turn. Processor time is that of all
processes of a command.
"""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.commands import ROOT, BeforeOption, Taken, checkouts, take
from benchmarks.program import (
    OutDirOption,
    QuickOption,
    RoundsOption,
    median,
    start,
    tracked,
)
from benchmarks.results import results_in
from hertzloop.cli.options import JsonOption
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
from hertzloop.results.model import chosen_model
from hertzloop.scene.build import free_series
from hertzloop.scene.setup import load
scene = load("aluminium-20mm", ["controller.law=off", "run.duration_s=0.006"])
with tempfile.TemporaryDirectory() as folder:
    for compiled in (False, True):
        record_in_process(scene, Path(folder, f"{compiled}.mcap"), compiled=compiled)
chosen_model(scene)
metrics_of(scene, free_series(scene))
metrics_of(scene, simulate(scene).truth)
print(json.dumps(Own.seconds))
"""


@dataclass(frozen=True)
class First:
    """Wall time and processor time of a command with an empty cache, s; medians of the rounds.
    `checkout`: "this" or "before"."""

    command: str
    checkout: str
    wall_s: float
    cpu_s: float


@dataclass(frozen=True)
class KernelCost:
    """Processor time that it takes to compile a function, s, in this checkout and in the other;
    None without it."""

    kernel: str
    now_s: float | None
    before_s: float | None


def _take(checkout: Path, words: list[str], folder: Path) -> Taken:
    """What a command takes with an empty cache."""
    with TemporaryDirectory(prefix="hertzloop-") as cache:
        return take(words, checkout, folder, {"NUMBA_CACHE_DIR": cache})


def measure(rounds: int, quick: bool, before: Path | None) -> list[First]:
    """The first commands of both checkouts in turn, as many rounds."""
    found: dict[tuple[str, str], list[Taken]] = {}
    with TemporaryDirectory(prefix="hertzloop-") as name:
        for _ in tracked("rounds", range(rounds)):
            for command, words in (_QUICK if quick else _COMMANDS).items():
                for checkout, root in checkouts(before).items():
                    own = Path(name, checkout)  # neither reads recordings of the other
                    own.mkdir(exist_ok=True)
                    taken = _take(root, [sys.executable, "-m", "hertzloop", *words], own)
                    found.setdefault((command, checkout), []).append(taken)
    return [
        First(*key, median(one.wall_s for one in some), median(one.cpu_s for one in some))
        for key, some in found.items()
    ]


def kernels(checkout: Path) -> dict[str, float]:
    """Processor time of each compiled function of the default scene, s.

    Raises:
        subprocess.CalledProcessError: the scene could not be run.
    """
    with TemporaryDirectory(prefix="hertzloop-") as name:
        _take(checkout, [sys.executable, "-c", _KERNELS], Path(name))
        found: dict[str, float] = json.loads(Path(name, "said.txt").read_text().splitlines()[-1])
    return found


def main(
    folder: OutDirOption = None,
    rounds: RoundsOption = 3,
    quick: QuickOption = False,
    before: BeforeOption = None,
    json_file: JsonOption = None,
) -> None:
    """Measure the first run, sweep and replay with no compiled kernels, and each kernel.

    Example: python -m benchmarks.first_run --quick
    """
    with results_in(folder, "first_run", json_file=json_file) as results:
        try:
            first = measure(1 if quick else rounds, quick, before)
            now = kernels(ROOT)
            then = kernels(before) if before else {}
        except subprocess.CalledProcessError as error:
            fail(f"a command failed: {error}", 1)
        names = sorted(now | then, key=lambda name: -max(now.get(name, 0.0), then.get(name, 0.0)))
        costs = [KernelCost(name, now.get(name), then.get(name)) for name in names]
        results.write("first", first)
        results.write("kernels", costs)
        results.table(
            "first commands, nothing compiled",
            {
                "command": "{.command}",
                "checkout": "{.checkout}",
                "wall time, s": "{.wall_s:.1f}",
                "processor time, s": "{.cpu_s:.1f}",
            },
            first,
            text=2,
        )
        results.table(
            "processor time to compile a function without those that it calls, s",
            {
                "function": "{.kernel}",
                "before": lambda cost: "" if cost.before_s is None else f"{cost.before_s:.2f}",
                "now": lambda cost: "" if cost.now_s is None else f"{cost.now_s:.2f}",
            },
            costs[:_SHOWN],
        )
        results.conclude(
            f"The kernels of the default scene are {len(now)} functions, which take "
            f"{sum(now.values()):.1f} s of processor time to compile."
        )


if __name__ == "__main__":
    start("benchmarks.first_run")
