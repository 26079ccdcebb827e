"""How long a user waits for one run: start of Python, the loop, and all that comes after it.

Every command is a process of its own with the kernels in the cache. Processor time is that of all
processes of a command. With another checkout the same commands of both are measured in turn.
"""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.commands import ROOT, BeforeOption, checkouts, take
from benchmarks.program import (
    OutDirOption,
    QuickOption,
    RoundsOption,
    median,
    start,
    tracked,
)
from benchmarks.results import results_in
from benchmarks.scenes import FOLDER
from hertzloop.cli.terminal import fail

_NAME = "aluminium-3mm"
_SCENE = str(FOLDER / f"{_NAME}.toml")
_FEEDBACK = ["--set", "controller.law=velocity_feedback", "--set", "controller.kappa=0.1"]
_RUNS = {
    "run, compiled": ["--transport", "compiled"],
    "run, zenoh": ["--realtime", "off"],
    "run, zenoh, feedback in shared memory": [*_FEEDBACK, "--realtime", "on"],
}
# Name of a row, the command that it is of, what is measured, unit, and aim.
_ROWS = (
    ("run, compiled, processor time", "run, compiled", "cpu_s", "s", 1.2),
    ("run, compiled, time", "run, compiled", "wall_s", "s", None),
    ("run, zenoh, processor time", "run, zenoh", "cpu_s", "s", 3.5),
    ("run, zenoh, time", "run, zenoh", "wall_s", "s", 2.5),
    ("run, zenoh, share of real time", "run, zenoh", "real_time", "", 2.0),
    (
        "feedback in shared memory, share of real time",
        "run, zenoh, feedback in shared memory",
        "real_time",
        "",
        1.0,
    ),
)


@dataclass(frozen=True)
class Row:
    """A row of the table: median and least of this checkout, and of the other one."""

    case: str
    unit: str
    aim: float | None
    median: float
    least: float
    before_median: float | None
    before_least: float | None


def _take(checkout: Path, command: str, folder: Path) -> dict[str, float]:
    """Run a command of a checkout: what it takes, and simulated over wall time of the loop."""
    report = folder / "run.json"
    words = ["run", _SCENE, *_RUNS[command], "--overwrite", "--json", str(report)]
    taken = take([sys.executable, "-m", "hertzloop", *words], checkout, folder)
    return asdict(taken) | {"real_time": json.loads(report.read_text())["real_time_factor"]}


def measure(rounds: int, before: Path | None) -> list[Row]:
    """All rows of the table; the checkouts take turns, and who is first alternates."""
    roots = list(checkouts(before).values())
    commands = list(_RUNS)
    found: dict[tuple[Path, str], list[dict[str, float]]] = {}
    with TemporaryDirectory(prefix="hertzloop-") as name:
        folder = Path(name)
        for checkout in roots:
            for command in commands:
                _take(checkout, command, folder)  # compiles and loads what is not in the cache
        for turn in tracked("commands", range(rounds * len(commands))):
            command = commands[turn % len(commands)]
            for checkout in roots if turn // len(commands) % 2 else roots[::-1]:
                found.setdefault((checkout, command), []).append(_take(checkout, command, folder))

    def numbers(checkout: Path, command: str, what: str) -> tuple[float, float]:
        values = [one[what] for one in found[checkout, command]]
        return median(values), max(values) if what == "real_time" else min(values)

    rows = []
    for case, command, what, unit, aim in _ROWS:
        old = numbers(before, command, what) if before else (None, None)
        rows.append(Row(case, unit, aim, *numbers(ROOT, command, what), *old))
    return rows


def _optional(name: str) -> Callable[[Row], str]:
    """A number of a row as text, empty where it is missing."""
    return lambda row: "" if getattr(row, name) is None else f"{getattr(row, name):.3g}"


def main(
    folder: OutDirOption = None,
    rounds: RoundsOption = 7,
    quick: QuickOption = False,
    before: BeforeOption = None,
) -> None:
    """Measure what one run costs, from the command to its last line, with start and end of Python.

    Example: python -m benchmarks.start --quick
    """
    with results_in(folder, "start") as results:
        try:
            rows = measure(1 if quick else rounds, before)
        except subprocess.CalledProcessError as error:
            fail(f"a command failed: {error.output.strip()}", 1)
        results.write("start", rows)
        results.table(
            f"one run of {_NAME}",
            {
                "case": "{.case}",
                "unit": "{.unit}",
                "aim": _optional("aim"),
                "median": "{.median:.3g}",
                "best": "{.least:.3g}",
                "before, median": _optional("before_median"),
                "before, best": _optional("before_least"),
            },
            rows,
            text=2,
        )
        found = {row.case: row for row in rows}
        compiled, bus = (found[f"run, {name}, processor time"] for name in ("compiled", "zenoh"))
        results.conclude(
            f"A run of {_NAME} takes {compiled.median:.2f} s of processor time compiled, and "
            f"{bus.median:.2f} s over zenoh."
        )


if __name__ == "__main__":
    start("benchmarks.start")
