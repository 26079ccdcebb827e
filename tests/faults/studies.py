"""Studies killed at random moments: `python -m tests.faults.studies --tries 40 --seed 7`.

Each try is a sweep, a budget, a tune or a fit whose processes are all killed, or interrupted, at a
random moment of an undisturbed one. The same command then has to end, with the files of the
undisturbed one, and no process may stay of either.
"""

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import psutil

from tests.faults.series import NotReached, Outcome, series
from tests.hertzloop.commands import EVENTUALLY_S, start, wait_for

_BENCH = Path(__file__).parents[2] / "docs" / "examples"
_COARSE = ["aluminium-3mm", "--set", "run.accuracy=0.05", "--json", "r.json"]
STUDIES: dict[str, list[str]] = {
    "sweep": ["sweep", *_COARSE, "--over", "controller.latency_us=0:199:1",
              "--over", "sensors.bits=4:11:1", "-o", "r.csv"],
    "budget": ["budget", *_COARSE, "--quick"],
    "tune": ["tune", *_COARSE, "--law", "predicted", "--set", "run.duration_s=0.0016",
             "--generations", "10", "--population", "40", "-o", "."],
    "fit": ["fit", str(_BENCH / "bench.toml"), str(_BENCH / "bench-force.csv"),
            "--free", "contact.limiting_pressure_pa", "--free", "plate.thickness_m",
            "--json", "r.json"],
}  # fmt: skip
_INTERRUPTS = 0.3  # part of the faults
# Of JSON: times, and how many cases the last start has run.
_OTHERWISE = {"wall_s", "cases_per_s", "ran"}
_UNFINISHED = ".hertzloop-"  # a file that was being written when its process was killed


@dataclass(frozen=True)
class Cut:
    """A signal to all processes of a study, after this share of the time that it takes."""

    study: str
    signal: str
    share: float


def draw(random_: random.Random) -> Cut:
    """Any of them."""
    sent = "SIGINT" if random_.random() < _INTERRUPTS else "SIGKILL"
    return Cut(random_.choice(list(STUDIES)), sent, random_.random())


def command(study: str, folder: Path) -> subprocess.Popen[str]:
    """Start a study in a session of its own, which heeds an interrupt: who runs the series in the
    background may ignore it."""
    folder.mkdir(exist_ok=True)
    heeding = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    return start(*STUDIES[study], cwd=folder, start_new_session=True, preexec_fn=heeding)


@cache
def whole(study: str) -> tuple[dict[str, Any], float]:
    """The files of an undisturbed study by name, and how long it takes, s."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        process = command(study, Path(folder))
        _, said = process.communicate()
        assert process.returncode == 0, said
        return files(Path(folder)), time.monotonic() - began


def files(folder: Path) -> dict[str, Any]:
    """What the files of a folder say, by name."""
    return {
        path.name: _numbers(json.loads(path.read_bytes()))
        if path.suffix == ".json"
        else path.read_bytes()
        for path in folder.iterdir()
        if not path.name.startswith(_UNFINISHED)
    }


def _numbers(data: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in data.items() if name not in _OTHERWISE}


def hit(cut: Cut, folder: Path) -> Outcome:
    """Cut a study short, start it again, and judge how it ends. Raises NotReached."""
    expected, lasts_s = whole(cut.study)
    sent, wrong = signal.Signals[cut.signal], list[str]()
    process, began = command(cut.study, folder), time.monotonic()
    with suppress(subprocess.TimeoutExpired):
        process.wait(cut.share * lasts_s)
    if process.poll() is None:
        os.killpg(process.pid, sent)
    _, said = process.communicate(timeout=EVENTUALLY_S)
    if process.returncode == 0:
        raise NotReached("it was over")
    ended = 130 if sent is signal.SIGINT else -sent
    if process.returncode != ended or "Traceback" in said:
        wrong.append(f"ended with {process.returncode}: {said}")
    if not _all_end(process.pid):
        wrong.append("processes left")
    again = command(cut.study, folder)
    _, said = again.communicate(timeout=2 * EVENTUALLY_S)
    if again.returncode:
        wrong.append(f"started again, ended with {again.returncode}: {said}")
    elif (found := files(folder)) != expected:
        names = sorted(n for n in found | expected if found.get(n) != expected.get(n))
        wrong.append(f"other files: {', '.join(names)}")
    if not _all_end(again.pid):
        wrong.append("processes left")
    return Outcome(time.monotonic() - began, said, wrong)


def _all_end(session: int) -> bool:
    """Whether all processes of a session end."""
    try:
        wait_for(lambda: not any(_is_of(process, session) for process in psutil.process_iter()))
    except AssertionError:
        return False
    return True


def _is_of(process: psutil.Process, session: int) -> bool:
    try:
        return os.getsid(process.pid) == session and process.status() != psutil.STATUS_ZOMBIE
    except (OSError, psutil.Error):
        return False


if __name__ == "__main__":
    sys.exit(series(__doc__, draw, hit, ("study", "signal")))
