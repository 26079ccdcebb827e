"""Processes that die or stop at random moments of a run in the fast lane, and what comes of it.

python -m tests.hertzloop.lane_deaths --tries 300 --seed 1 prints a table.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import psutil

from recordings.reader import read
from recordings.writer import RecordingError
from tests.hertzloop.processes import child_of, finish, grown_to, leftovers, start, wait_for

ROLES = {"plant": "plant", "controller": "controller", "recorder": "record"}
ENDS = {
    "killed": (signal.SIGKILL, "was killed by SIGKILL"),
    "stopped": (signal.SIGSTOP, "react any more"),
    "crashed": (signal.SIGSEGV, "was killed by SIGSEGV"),
}
FEEDBACK = [
    "--set", "controller.law=velocity_feedback", "--set", "controller.kappa=0.1",
    "--set", "run.duration_s=19", "--timeout", "2",
]  # fmt: skip
HANGS_S = 60.0
UNDER_WAY, MOMENTS_S = 100_000, 1.5  # bytes; a random time after that


@dataclass(frozen=True)
class Death:
    """What came of one: the sentence, how long it took, and what was left behind."""

    said: str
    named: bool
    seconds: float
    orphans: int
    shared: int  # entries of /dev/shm more than before
    readable: bool


class NotUnderWay(Exception):
    """The run did not get going in time, as on a machine that is too busy: nothing died."""


def die(role: str, how: str, after_s: float, folder: Path) -> Death:
    """Start a run, let one process of it die or stop, and wait for the end. Raises NotUnderWay."""
    recording, shared = folder / "run.mcap", _shared()
    number, words = ENDS[how]
    run = start("run", *FEEDBACK, "--out", str(recording))
    try:
        victim = child_of(run, ROLES[role])
        wait_for(grown_to(recording, UNDER_WAY))
        time.sleep(after_s)
        victim.send_signal(number)
    except AssertionError as error:
        run.terminate()
        _, said, _ = finish(run, HANGS_S)
        _end_all(recording)
        raise NotUnderWay(f"{error}; the run said: {said}") from error
    try:
        code, said, seconds = finish(run, HANGS_S)
    except subprocess.TimeoutExpired:
        code, said, seconds = 0, "it hangs", HANGS_S
    orphans = leftovers(recording)
    _end_all(recording)
    try:
        readable = bool(read(recording).problems)
    except (RecordingError, OSError):
        readable = False
    named = code == 1 and role in said and words in said and "Traceback" not in said
    return Death(said, named, seconds, len(orphans), len(_shared() - shared), readable)


def _end_all(recording: Path) -> None:
    """End what is left of the run that wrote a recording."""
    for process in psutil.process_iter(["cmdline"]):
        if any(str(recording) in word for word in process.info["cmdline"] or []):
            process.kill()


def _shared() -> set[str]:
    """Entries of /dev/shm that could be ours: none of other programs'."""
    return {name for name in os.listdir("/dev/shm") if "hertzloop" in name or "psm_" in name}


def main() -> int:
    """Print the table; the number of deaths after which something was wrong."""
    options = argparse.ArgumentParser()
    options.add_argument("--tries", type=int, default=300)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--first", type=int, default=0, help="leave out the tries before")
    given = options.parse_args()
    draw, wrong, late = random.Random(given.seed), 0, 0
    found: dict[tuple[str, str], list[Death]] = defaultdict(list)
    for i in range(given.tries):
        role, how = draw.choice(list(ROLES)), draw.choice(list(ENDS))
        after_s = draw.uniform(0.0, MOMENTS_S)
        if i < given.first:
            continue
        try:
            with tempfile.TemporaryDirectory() as folder:
                death = die(role, how, after_s, Path(folder))
        except NotUnderWay as error:
            late += 1
            print(f"try {i}, {role} {how}, {error}", file=sys.stderr, flush=True)
            continue
        except KeyboardInterrupt:  # the table of what was tried until then
            break
        found[role, how].append(death)
        if not (death.named and death.readable) or death.orphans or death.shared:
            wrong += 1
            print(f"try {i}, {role} {how}: {death}", file=sys.stderr, flush=True)
    print(f"{'process':12}{'how':10}{'tries':>6}{'named':>7}{'longest s':>11}{'orphans':>9}"
          f"{'/dev/shm':>10}{'readable':>10}")  # fmt: skip
    for (role, how), deaths in sorted(found.items()):
        print(
            f"{role:12}{how:10}{len(deaths):6}{sum(d.named for d in deaths):7}"
            f"{max(d.seconds for d in deaths):11.1f}{sum(d.orphans for d in deaths):9}"
            f"{sum(d.shared for d in deaths):10}{sum(d.readable for d in deaths):10}"
        )
    print(f"{sum(map(len, found.values()))} tries, something wrong after {wrong}; {late} more "
          "runs were not under way in time, and nothing died")  # fmt: skip
    return wrong


if __name__ == "__main__":
    sys.exit(min(main(), 1))
