"""What the first commands of a newcomer cost: all kernels are compiled, from an empty cache.

With another checkout, each command of both is measured in turn. Processor time is that of all
processes of a command.
"""

import json
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.program import (
    BeforeOption,
    JsonOption,
    OutDirOption,
    QuickOption,
    RoundsOption,
    bars,
    check_json,
    conclude,
    cost_of,
    fail,
    median,
    number_table,
    out,
    results_in,
    start,
    tracked,
    write_json,
    write_records,
    written,
)

_ROOT = Path(__file__).resolve().parent.parent
_COMMANDS = {
    "run": ["run", "--overwrite", "--out", "first.mcap"],
    "sweep": ["sweep", "--over", "controller.latency_us=0,5", "--overwrite", "--out", "first.csv"],
    "replay": ["replay", "first.mcap", "--save", "first.rrd", "--overwrite"],
}
_QUICK = {"version": ["--version"]}
_SHOWN = 25  # kernels in the table
# Runs each kernel of the default scene in one process, in any version of hertzloop; prints the
# processor time of each function without that of the functions that it calls.
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
try:
    from hertzloop.loop.in_process import record_in_process
    from hertzloop.loop.simulate import simulate
    from hertzloop.results.metrics import metrics_of
    from hertzloop.results.model import chosen_model
    from hertzloop.scene.build import free_series
    from hertzloop.scene.setup import load
except ImportError:  # an earlier version
    from hertzloop.analysis.metrics import metrics_of
    from hertzloop.analysis.model import chosen_model
    from hertzloop.loop.compiled import record_in_process, simulate
    from hertzloop.setup import load
    from hertzloop.setup.parts import free_series
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


def take(checkout: Path, words: list[str], folder: Path) -> tuple[float, float]:
    """Wall time and processor time of a command with an empty cache, s; see `cost_of`."""
    with TemporaryDirectory(prefix="hertzloop-") as cache:
        return cost_of(words, checkout, folder, {"NUMBA_CACHE_DIR": cache})


def measure(rounds: int, quick: bool, before: Path | None) -> list[First]:
    """The first commands of both checkouts in turn, as many rounds."""
    roots = {"this": _ROOT} | ({} if before is None else {"before": before})
    commands = _QUICK if quick else _COMMANDS
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    with TemporaryDirectory(prefix="hertzloop-") as name:
        for _ in tracked("rounds", range(rounds)):
            for command, words in commands.items():
                for checkout, root in roots.items():
                    whole = [sys.executable, "-m", "hertzloop", *words]
                    own = Path(name, checkout)  # neither reads recordings of the other
                    own.mkdir(exist_ok=True)
                    taken = take(root, whole, own)
                    found.setdefault((command, checkout), []).append(taken)
    return [
        First(*key, *(median(column) for column in zip(*some, strict=True)))
        for key, some in found.items()
    ]


def kernels(checkout: Path) -> dict[str, float]:
    """Processor time of each compiled function of the default scene, s.

    Raises:
        subprocess.CalledProcessError: the scene could not be run.
    """
    with TemporaryDirectory(prefix="hertzloop-") as name:
        take(checkout, [sys.executable, "-c", _KERNELS], Path(name))
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
    check_json(json_file)
    with results_in(folder, "first_run") as made:
        try:
            first = measure(1 if quick else rounds, quick, before)
            now = kernels(_ROOT)
            then = kernels(before) if before else {}
        except subprocess.CalledProcessError as error:
            fail(f"a command failed: {error}", 1)
        names = sorted(now | then, key=lambda name: -max(now.get(name, 0.0), then.get(name, 0.0)))
        costs = [KernelCost(name, now.get(name), then.get(name)) for name in names]
        write_records(made / "first_run.csv", first)
        write_records(made / "kernels.csv", costs)
        largest = [(cost.kernel, cost.now_s or 0.0) for cost in costs[:_SHOWN]]
        bars(made / "first_run.png", "Kernels that take longest to compile", "s", largest)
    rows = [(c.command, c.checkout, f"{c.wall_s:.1f}", f"{c.cpu_s:.1f}") for c in first]
    headings = ("command", "checkout", "wall time, s", "processor time, s")
    out.print(number_table("first commands, nothing compiled", headings, rows, text=2))
    cells = [
        (cost.kernel, *("" if s is None else f"{s:.2f}" for s in (cost.before_s, cost.now_s)))
        for cost in costs[:_SHOWN]
    ]
    title = "processor time to compile a function without those that it calls, s"
    out.print(number_table(title, ("function", "before", "now"), cells, text=1))
    written(made, "first_run.csv", "kernels.csv", "first_run.png")
    conclude(
        f"The kernels of the default scene are {len(now)} functions, which take "
        f"{sum(now.values()):.1f} s of processor time to compile."
    )
    write_json(
        json_file,
        {"first": [asdict(row) for row in first], "kernels": [asdict(row) for row in costs]},
    )


if __name__ == "__main__":
    start("benchmarks.first_run")
