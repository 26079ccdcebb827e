"""Faults at random moments of real runs, and what comes of them, as a table.

`python -m tests.faults.runs --tries 1000 --seed 1`: every try is a `hertzloop run`, with the fast
lane or without. One of its processes, or the launcher, is killed, crashes, stops for good or for a
while, is terminated or interrupted, while the run starts or is under way. After it: no hang, no
process left, the right cause, a recording that can be read. A run ends by itself, or, where it has
to go on (after a short pause), by an interrupt.

What is lost of the streams is counted in ms of wall time: from the last time that the recorder's
file grew to the fault, if the fault kept the recorder from closing it.
"""

import argparse
import os
import random
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from recordings.reader import read
from recordings.writer import RecordingError
from tests.faults import page
from tests.hertzloop.processes import child_of, grown_to, leftovers, start, wait_for

COMMANDS = {"plant": "plant", "controller": "controller", "recorder": "record"}
LAUNCHER = "launcher"
SIGNALS = {
    "kill": signal.SIGKILL, "crash": signal.SIGSEGV, "stop": signal.SIGSTOP,
    "pause": signal.SIGSTOP, "long pause": signal.SIGSTOP,
    "terminate": signal.SIGTERM, "interrupt": signal.SIGINT,
}  # fmt: skip
TIMEOUT_S = 4.0  # patience of the processes with one another
PAUSES_S = {"pause": (0.05, 1.0), "long pause": (TIMEOUT_S + 2.0, TIMEOUT_S + 4.0)}
RUN = ["--set", "run.duration_s=19", "--timeout", str(TIMEOUT_S)]
EVERY_SAMPLE = ["--set", "controller.law=velocity_feedback", "--set", "controller.kappa=0.1"]
LANE = {"lane": EVERY_SAMPLE, "no lane": ["--no-fast-lane"]}
HANGS_S = 120.0
UNDER_WAY, MOMENTS_S = 100_000, 1.5  # bytes; a random time after that, or after a process is there
MOST_LOST_MS = 100.0


@dataclass(frozen=True)
class Fault:
    """What is done to whom, and when: s after it is there, or after the run is under way."""

    victim: str
    how: str
    lane: str
    starting: bool
    after_s: float
    pause_s: float = 0.0


@dataclass
class Outcome:
    """What came of one; `wrong` says in words what should not be."""

    said: str
    seconds: float
    lost_ms: float = 0.0
    wrong: list[str] = field(default_factory=list)


class NotUnderWay(Exception):
    """The run did not get going, or was over, before anything was done to it."""


def draw(random_: random.Random) -> Fault:
    """Any fault. Who stops while the others wait for him to appear is waited for for minutes: only
    a run under way has to end soon then, and the launcher is waited for by nobody."""
    victim = random_.choice([*COMMANDS, LAUNCHER])
    how = random_.choice([h for h in SIGNALS if victim != LAUNCHER or h not in ("stop", "crash")])
    starting = random_.random() < 0.25 and how not in ("stop", "long pause")
    pause_s = random_.uniform(*PAUSES_S.get(how, (0.0, 0.0)))
    return Fault(
        victim, how, random_.choice(list(LANE)), starting, random_.uniform(0, MOMENTS_S), pause_s
    )


def may_go_on(fault: Fault) -> bool:
    """Whether the run has to survive it: the pause is short, or nobody waits for who pauses."""
    return fault.how == "pause" or (fault.how == "long pause" and fault.victim == LAUNCHER)


def wrong_words(fault: Fault, code: int, said: str) -> str:
    """What is wrong with the exit code and the cause that was told, "" if nothing."""
    if "Traceback" in said:
        return "a traceback"
    if fault.victim == LAUNCHER and fault.how == "kill":
        return "" if code == -signal.SIGKILL else f"exit code {code}"
    if may_go_on(fault) or fault.victim == LAUNCHER:
        return "" if code == 130 and "interrupted" in said else f"exit code {code}"
    name = SIGNALS[fault.how].name
    words = {
        "kill": [f"{fault.victim} was killed by {name}"],
        "crash": [f"{fault.victim} was killed by {name}"],
        "stop": [f"{fault.victim} does not react any more"],
        # Awake again, it says that it lost the others, or hears that they lost it.
        "long pause": [f"{fault.victim} does not react any more", f"from {fault.victim}:",
                       f"from the {fault.victim}:", f"{fault.victim} took no message",
                       f"{fault.victim} left the run"],
        "terminate": [f"{fault.victim} was interrupted", f"killed by {name}"],
        "interrupt": [f"{fault.victim} was interrupted"],
    }[fault.how]  # fmt: skip
    if code != 1:
        return f"exit code {code}"
    return "" if any(word in said for word in words) else "another cause"


def inflict(fault: Fault, folder: Path) -> Outcome:
    """Start a run, do it, and wait for the end. Raises NotUnderWay."""
    recording, temporary = folder / "run.mcap", folder / "t"
    temporary.mkdir()
    began = time.monotonic()
    words = [*RUN, *LANE[fault.lane], "--out", str(recording)]
    run = start("run", *words, env={**os.environ, "TMPDIR": str(temporary)})
    children: list[psutil.Process] = []
    try:
        try:
            known = {role: child_of(run, command) for role, command in COMMANDS.items()}
            children = list(known.values())
            victim = known.get(fault.victim) or psutil.Process(run.pid)
            if not fault.starting:
                wait_for(grown_to(recording, UNDER_WAY))
            time.sleep(fault.after_s)
            if run.poll() is not None:
                raise AssertionError("it is over")
            victim.send_signal(SIGNALS[fault.how])
        except (AssertionError, psutil.Error) as error:
            raise NotUnderWay(f"{error or type(error).__name__}") from error
        done_at = time.time()
        if fault.pause_s:
            time.sleep(fault.pause_s)
            if victim.is_running():
                victim.send_signal(signal.SIGCONT)
        if may_go_on(fault):
            went_on = _goes_on(run, recording)
            run.send_signal(signal.SIGINT)
        else:
            went_on = True
        outcome = _ended(fault, run, children, began)
        if not went_on:
            outcome.wrong.append("it did not go on")
        if left := leftovers(recording):
            outcome.wrong.append(f"{len(left)} processes left")
        if any(temporary.iterdir()) and not (fault.victim == LAUNCHER and fault.how == "kill"):
            outcome.wrong.append("temporary files stay")
        _judge_recording(fault, recording, done_at, outcome)
        return outcome
    finally:
        for process in children:
            if process.is_running():
                process.kill()
        if run.poll() is None:
            run.kill()
        run.communicate()


def _goes_on(run: subprocess.Popen, recording: Path) -> bool:
    """Whether the recording grows again."""
    now = recording.stat().st_size if recording.exists() else 0
    try:
        wait_for(lambda: run.poll() is not None or grown_to(recording, now + UNDER_WAY)())
    except AssertionError:
        return False
    return run.poll() is None


def _ended(
    fault: Fault, run: subprocess.Popen, children: list[psutil.Process], began: float
) -> Outcome:
    """The end of a run, and of its processes; a hang is wrong."""
    try:
        _, said = run.communicate(timeout=HANGS_S)
    except subprocess.TimeoutExpired:
        return Outcome("", HANGS_S, wrong=["it hangs"])
    said = " ".join(said.split())
    outcome = Outcome(said, time.monotonic() - began)
    if words := wrong_words(fault, run.returncode, said):
        outcome.wrong.append(words)
    if fault.victim == LAUNCHER and fault.how == "kill":
        psutil.wait_procs(children, timeout=HANGS_S)  # they notice by themselves
    return outcome


def _judge_recording(fault: Fault, recording: Path, done_at: float, outcome: Outcome) -> None:
    if fault.starting and not recording.exists():
        return
    try:
        kept = read(recording)
    except (RecordingError, OSError) as error:
        if not (fault.starting and recording.exists() and recording.stat().st_size == 0):
            outcome.wrong.append(f"unreadable: {error}")
        return
    if not kept.problems:
        outcome.wrong.append("said to be complete")
    if "the recorder did not finish the file" in kept.problems and not fault.starting:
        outcome.lost_ms = max(0.0, 1e3 * (done_at - recording.stat().st_mtime))


def table(found: dict[tuple[str, str, str], list[Outcome]], late: int) -> str:
    """A row for each kind of fault."""
    counted = ("it hangs", "processes left", "unreadable", "cause", "exit code", "other")

    def count(outcomes: list[Outcome], word: str) -> int:
        if word == "other":
            return sum(
                any(not any(w in said for w in counted) for said in one.wrong) for one in outcomes
            )
        return sum(any(word in said for said in one.wrong) for one in outcomes)

    head = (
        "process", "fault", "fast lane", "tries", "hangs", "processes left", "unreadable",
        "wrong cause", "wrong exit code", "otherwise wrong", "most lost, ms", "above 100 ms",
        "longest, s",
    )  # fmt: skip
    rows = []
    for key, outcomes in sorted(found.items()):
        lost_ms = [one.lost_ms for one in outcomes]
        rows.append([
            *key, len(outcomes), *(count(outcomes, word) for word in counted),
            f"{max(lost_ms):.0f}", sum(ms > MOST_LOST_MS for ms in lost_ms),
            f"{max(one.seconds for one in outcomes):.0f}",
        ])  # fmt: skip
    everything = [one for outcomes in found.values() for one in outcomes]
    wrong = sum(bool(one.wrong) for one in everything)
    lost = sum(one.lost_ms > MOST_LOST_MS for one in everything)
    return (
        f"{page.markdown(head, rows, words=3)}\n\n{len(everything)} tries, something wrong after "
        f"{wrong}, more than {MOST_LOST_MS:.0f} ms lost after {lost}; {late} runs were over, or "
        "not under way in time"
    )


def main() -> int:
    """Print the table; 1 if something was wrong."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--tries", type=int, default=1000)
    options.add_argument("--seed", type=int, default=secrets.randbits(32))
    options.add_argument("--first", type=int, default=0, help="leave out the tries before")
    options.add_argument("--page", action="store_true", help="put the table into docs/faults.md")
    given = options.parse_args()
    print(f"seed {given.seed}", flush=True)
    random_, late = random.Random(given.seed), 0
    found: dict[tuple[str, str, str], list[Outcome]] = defaultdict(list)
    for number in range(given.tries):
        fault = draw(random_)
        if number < given.first:
            continue
        try:
            with tempfile.TemporaryDirectory() as folder:
                outcome = inflict(fault, Path(folder))
        except NotUnderWay as error:
            late += 1
            print(f"try {number}, {fault}: {error}", file=sys.stderr, flush=True)
            continue
        except KeyboardInterrupt:  # the table of what was tried until then
            break
        found[fault.victim, fault.how, fault.lane].append(outcome)
        if outcome.wrong or outcome.lost_ms > MOST_LOST_MS:
            print(f"try {number}, {fault}: {outcome}", file=sys.stderr, flush=True)
    print(made := table(found, late))
    if given.page:
        tried = given.first + late + sum(map(len, found.values()))
        first = f" --first {given.first}" if given.first else ""
        words = f"python -m tests.faults.runs --tries {tried} --seed {given.seed}{first}"
        page.put("runs", words, made)
    return int(any(one.wrong or one.lost_ms > MOST_LOST_MS for o in found.values() for one in o))


if __name__ == "__main__":
    sys.exit(main())
