"""How long a user waits for one run: start of Python, the loop, and all that comes after it.

Every command is a process of its own with the kernels in the cache. Processor time is that of all
processes of a command. With another checkout the same commands of both are measured in turn.
"""

import ctypes
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
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
    environment_of,
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

_SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER: orphans of a command become children of this process
_ROOT = Path(__file__).resolve().parent.parent
_SCENE = "aluminium-3mm"
_FEEDBACK = ["--set", "controller.law=velocity_feedback", "--set", "controller.kappa=0.1"]
_RUNS = {
    "run, compiled": ["--transport", "compiled"],
    "run, zenoh": ["--realtime", "off"],
    "run, zenoh, feedback in the lane": [*_FEEDBACK, "--realtime", "on"],
}
# Name of a row, the command that it is of, what is measured, unit, and aim.
_ROWS = (
    ("hertzloop --version, processor time", "version", "cpu_s", "s", 0.25),
    ("run, compiled, processor time", "run, compiled", "cpu_s", "s", 1.2),
    ("run, compiled, time", "run, compiled", "wall_s", "s", None),
    ("run, compiled, memory of the largest process", "run, compiled", "memory_mb", "MB", None),
    ("run, zenoh, processor time", "run, zenoh", "cpu_s", "s", 3.5),
    ("run, zenoh, time", "run, zenoh", "wall_s", "s", 2.5),
    ("run, zenoh, memory of the largest process", "run, zenoh", "memory_mb", "MB", None),
    ("run, zenoh, share of real time", "run, zenoh", "real_time", "", 2.0),
    ("feedback in the lane, share of real time", "run, zenoh, feedback in the lane", "real_time",
     "", 1.0),
)  # fmt: skip


@dataclass(frozen=True)
class Taken:
    """What one command took: time (s), processor time of all of its processes (s), memory of the
    largest one (MB), and simulated over wall time of the loop, 0 of a command without a run."""

    wall_s: float
    cpu_s: float
    memory_mb: float
    real_time: float


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


@contextmanager
def _all_processes() -> Iterator[None]:
    """Become the parent of every process whose parent has ended, to wait for it."""
    control = ctypes.CDLL(None).prctl
    control(_SUBREAPER, 1, 0, 0, 0)
    try:
        yield
    finally:
        control(_SUBREAPER, 0, 0, 0, 0)


def take(checkout: Path, command: str, folder: Path) -> Taken:
    """Run a command of a checkout, to the end of all of its processes.

    Args:
        checkout: folder that holds `hertzloop`.
        command: a key of `_RUNS`, or "version".
        folder: working folder, for the recording.

    Raises:
        subprocess.CalledProcessError: the command failed.
    """
    words = ["--version"]
    told = folder / "run.json"
    if command in _RUNS:
        words = ["run", _SCENE, *_RUNS[command], "--overwrite", "--json", str(told)]
    with (folder / "said.txt").open("w") as said:
        began = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-m", "hertzloop", *words],
            cwd=folder, env=environment_of(checkout), stdout=said, stderr=said,
        )  # fmt: skip
        _, status, used = os.wait4(process.pid, 0)
        wall_s = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    spent, memory = used.ru_utime + used.ru_stime, used.ru_maxrss
    while True:
        try:
            _, _, used = os.wait4(-1, 0)
        except ChildProcessError:
            break
        spent, memory = spent + used.ru_utime + used.ru_stime, max(memory, used.ru_maxrss)
    if process.returncode:
        text = (folder / "said.txt").read_text()
        raise subprocess.CalledProcessError(process.returncode, process.args, text)
    report = json.loads(told.read_text()) if command in _RUNS else {}
    return Taken(wall_s, spent, memory / 1024.0, report.get("real_time_factor", 0.0))


def measure(rounds: int, before: Path | None) -> list[Row]:
    """All rows of the table; the checkouts take turns, and who is first alternates."""
    checkouts = [_ROOT, *([before] if before else [])]
    commands = ["version", *_RUNS]
    found: dict[tuple[Path, str], list[Taken]] = {}
    with TemporaryDirectory(prefix="hertzloop-") as name, _all_processes():
        folder = Path(name)
        for checkout in checkouts:
            for command in commands[1:]:
                take(checkout, command, folder)  # compiles and loads what is not in the cache
        for turn in tracked("commands", range(rounds * len(commands))):
            command = commands[turn % len(commands)]
            order = checkouts if turn // len(commands) % 2 else checkouts[::-1]
            for checkout in order:
                found.setdefault((checkout, command), []).append(take(checkout, command, folder))

    def numbers(checkout: Path, command: str, what: str) -> tuple[float, float]:
        values = [getattr(one, what) for one in found[checkout, command]]
        best = max(values) if what == "real_time" else min(values)
        return median(values), best

    rows = []
    for case, command, what, unit, aim in _ROWS:
        old = numbers(before, command, what) if before else (None, None)
        rows.append(Row(case, unit, aim, *numbers(_ROOT, command, what), *old))
    return rows


def main(
    folder: OutDirOption = None,
    rounds: RoundsOption = 7,
    quick: QuickOption = False,
    before: BeforeOption = None,
    json_file: JsonOption = None,
) -> None:
    """Measure what one run costs, from the command to its last line, with start and end of Python.

    Example: python -m benchmarks.start --quick
    """
    check_json(json_file)
    with results_in(folder, "start") as made:
        try:
            rows = measure(1 if quick else rounds, before)
        except subprocess.CalledProcessError as error:
            fail(f"a command failed: {error.output.strip()}", 1)
        write_records(made / "start.csv", rows)
        sizes = [(row.case, row.median) for row in rows]
        bars(made / "start.png", f"One run of {_SCENE}", "s, MB or share", sizes, log=True)
    headings = ("case", "unit", "aim", "median", "best", "before, median", "before, best")
    cells = [
        (row.case, row.unit, *(
            "" if value is None else f"{value:.3g}"
            for value in (row.aim, row.median, row.least, row.before_median, row.before_least)
        ))
        for row in rows
    ]  # fmt: skip
    out.print(number_table(f"one run of {_SCENE}", headings, cells, text=2))
    written(made, "start.csv", "start.png")
    found = {row.case: row for row in rows}
    compiled, bus = (found[f"run, {name}, processor time"] for name in ("compiled", "zenoh"))
    conclude(
        f"A run of {_SCENE} takes {compiled.median:.2f} s of processor time compiled, and "
        f"{bus.median:.2f} s over zenoh."
    )
    write_json(json_file, {"start": [asdict(row) for row in rows]})


if __name__ == "__main__":
    start("benchmarks.start")
