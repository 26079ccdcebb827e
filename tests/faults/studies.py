"""Studies killed at random moments: `python -m tests.faults.studies --tries 10 --seed 7`.

Each try is a sweep, a budget, a tune or a fit whose processes are all killed, or interrupted, at a
random moment of an undisturbed one. The same command then has to end, with the files of the
undisturbed one, and nothing may stay of either. `--page` writes the table into the page of faults.
"""

import argparse
import json
import os
import random
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import psutil

from tests.faults import page
from tests.hertzloop.commands import EVENTUALLY_S, start, wait_for
from tests.tables import markdown

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
class Hit:
    """What came of one fault.

    Attributes:
        sent: the signal; None for a command that had ended before.
        kept: lines of journals after it, of finished cases.
        wrong: what should not be, in words.
    """

    sent: signal.Signals | None
    kept: int
    wrong: list[str]


def command(study: str, folder: Path) -> subprocess.Popen[str]:
    """Start a study in a session of its own, which heeds an interrupt: who runs the series in the
    background may ignore it."""
    folder.mkdir(exist_ok=True)
    heeding = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    return start(*STUDIES[study], cwd=folder, start_new_session=True, preexec_fn=heeding)


def whole(study: str, folder: Path) -> tuple[dict[str, Any], float]:
    """The files of an undisturbed study by name, and how long it takes, s."""
    began = time.monotonic()
    process = command(study, folder)
    _, said = process.communicate()
    assert process.returncode == 0, said
    return files(folder), time.monotonic() - began


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


def hit(
    study: str, sent: signal.Signals, after_s: float, expected: dict[str, Any], folder: Path
) -> Hit:
    """Send a signal to all processes of a study, start it again, and judge how it ends."""
    process = command(study, folder)
    wrong = []
    with suppress(subprocess.TimeoutExpired):
        process.wait(after_s)
    if process.poll() is None:
        os.killpg(process.pid, sent)
    _, said = process.communicate(timeout=EVENTUALLY_S)
    over = process.returncode == 0
    ended = 130 if sent is signal.SIGINT else -sent
    if process.returncode not in (0, ended) or "Traceback" in said:
        wrong.append(f"ended with {process.returncode}: {said}")
    if not _all_end(process.pid):
        wrong.append("processes left")
    kept = sum(max(0, path.read_bytes().count(b"\n") - 1) for path in folder.glob("*.partial"))
    again = command(study, folder)
    _, said = again.communicate(timeout=2 * EVENTUALLY_S)
    if again.returncode:
        wrong.append(f"started again, ended with {again.returncode}: {said}")
    elif (found := files(folder)) != expected:
        names = sorted(n for n in found | expected if found.get(n) != expected.get(n))
        wrong.append(f"other files: {', '.join(names)}")
    if not _all_end(again.pid):
        wrong.append("processes left")
    return Hit(None if over else sent, kept, wrong)


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


def row(study: str, hits: Sequence[Hit]) -> list[object]:
    """The row of a study in the table."""
    kept = [one.kept for one in hits if one.sent]
    sent = [one.sent for one in hits]
    return [
        study,
        sent.count(signal.SIGKILL),
        sent.count(signal.SIGINT),
        sent.count(None),
        f"{min(kept)} to {max(kept)}" if any(kept) else "none",
        sum(bool(one.wrong) for one in hits),
    ]


def main() -> int:
    """Print the table; 1 if something was wrong."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--tries", type=int, default=10, help="faults of each study")
    options.add_argument("--seed", type=int, default=secrets.randbits(32))
    options.add_argument("--only", choices=STUDIES, action="append", help="this study; repeatable")
    wish = "write the table to docs/evidence/faults.md"
    options.add_argument("--page", action="store_true", help=wish)
    given = options.parse_args()
    print(f"seed {given.seed}", flush=True)
    random_, rows = random.Random(given.seed), []
    for study in given.only or STUDIES:
        hits: list[Hit] = []
        with tempfile.TemporaryDirectory() as folder:
            expected, lasts_s = whole(study, Path(folder))
        while sum(one.sent is not None for one in hits) < given.tries:
            sent = signal.SIGINT if random_.random() < _INTERRUPTS else signal.SIGKILL
            after_s = random_.uniform(0.0, lasts_s)
            with tempfile.TemporaryDirectory() as folder:
                hits.append(hit(study, sent, after_s, expected, Path(folder)))
            print(f"{study}, {sent.name} after {after_s:.2f} s: {hits[-1]}", flush=True)
        rows.append(row(study, hits))
    head = ("study", "killed", "interrupted", "over before", "finished cases kept", "wrong")
    print(made := markdown(head, rows))
    if given.page:
        page.put(
            "studies",
            f"python -m tests.faults.studies --tries {given.tries} --seed {given.seed}",
            made,
        )
    return int(any(one[-1] for one in rows))


if __name__ == "__main__":
    sys.exit(main())
