"""A fault at a random moment of a real run, and what comes of it; a series of them, as a table.

`python -m tests.faults.runs --tries 1000 --seed 1`: every try is a `hertzloop run`, in shared
memory or over the bus. One of its processes, or the launcher, is killed, crashes, stops for good or
for a while, is terminated or interrupted, while the run starts or is under way. After it: no hang,
no process left, the right cause, a recording that can be read. A run ends by itself, or, where it
has to go on (after a short pause), by an interrupt.

What is lost of the streams is counted in ms of wall time: from the last time that the recorder's
file grew to the fault, if the fault kept the recorder from closing it.
"""

import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import psutil

from hertzloop.bus.streams import ROLES
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.inspection import inspected
from hertzloop.views.run_json import inspection_as_json
from tests.faults.series import NotReached, Outcome, series
from tests.hertzloop.commands import child_of, grown_to, leftovers, start, wait_for

LAUNCHER = "launcher"
SIGNALS = {
    "kill": signal.SIGKILL,
    "crash": signal.SIGSEGV,
    "stop": signal.SIGSTOP,
    "pause": signal.SIGSTOP,
    "long pause": signal.SIGSTOP,
    "terminate": signal.SIGTERM,
    "interrupt": signal.SIGINT,
}
CLOSED = {"hang up": signal.SIGHUP}  # of a terminal; not drawn
TIMEOUT_S = 4.0  # patience of the processes with one another
PAUSES_S = {"pause": (0.05, 1.0), "long pause": (TIMEOUT_S + 2.0, TIMEOUT_S + 4.0)}
RUN = ["aluminium-3mm", "--set", "run.duration_s=19", "--timeout", str(TIMEOUT_S)]
EVERY_SAMPLE = ["--set", "controller.law=velocity_feedback", "--set", "controller.kappa=0.1"]
WAYS = {"shared memory": EVERY_SAMPLE, "bus": ["--no-shared-memory"]}
HANGS_S, MOST_LOST_MS = 120.0, 100.0
UNDER_WAY, MOMENTS_S = 100_000, 1.5  # bytes; a random time after that, or after a process is there


@dataclass(frozen=True)
class Fault:
    """What is done to whom, and when: s after it is there, or after the run is under way."""

    victim: str
    how: str
    way: str
    starting: bool
    after_s: float
    pause_s: float = 0.0


def draw(random_: random.Random) -> Fault:
    """Any fault. Who stops while the others wait for him to appear is waited for for minutes: only
    a run under way has to end soon then, and the launcher is waited for by nobody."""
    victim = random_.choice([*ROLES, LAUNCHER])
    how = random_.choice([h for h in SIGNALS if victim != LAUNCHER or h not in ("stop", "crash")])
    starting = random_.random() < 0.25 and how not in ("stop", "long pause")
    pause_s = random_.uniform(*PAUSES_S.get(how, (0.0, 0.0)))
    return Fault(
        victim, how, random_.choice(list(WAYS)), starting, random_.uniform(0, MOMENTS_S), pause_s
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
        "stop": [f"{fault.victim} does not respond"],
        "long pause": [
            f"from the {fault.victim}: nothing came",
            f"{fault.victim} does not respond",
            f"{fault.victim} or an observer accepted no message",
            f"{fault.victim} left the run",
        ],
        "terminate": [f"{fault.victim} was interrupted", f"killed by {name}"],
        "interrupt": [f"{fault.victim} was interrupted"],
    }[fault.how]
    if code != 1:
        return f"exit code {code}"
    if said.count("error:") > 1:
        return "more than one error"
    return "" if any(word in said for word in words) else "another cause"


def inflict(fault: Fault, folder: Path) -> Outcome:
    """Start a run, do it, and wait for the end. Raises NotReached."""
    recording, temporary = folder / "run.mcap", folder / "t"
    temporary.mkdir()
    began = time.monotonic()
    words = [*RUN, *WAYS[fault.way], "--out", str(recording)]
    number = (SIGNALS | CLOSED)[fault.how]
    heeding = None
    if fault.how in CLOSED:  # who runs the tests may ignore it
        heeding = partial(signal.signal, number, signal.SIG_DFL)
    run = start("run", *words, env={**os.environ, "TMPDIR": str(temporary)}, preexec_fn=heeding)
    children: list[psutil.Process] = []
    try:
        try:
            known = {role: child_of(run, role) for role in ROLES}
            children = list(known.values())
            victim = known.get(fault.victim) or psutil.Process(run.pid)
            if not fault.starting:
                wait_for(grown_to(recording, UNDER_WAY))
            time.sleep(fault.after_s)
            if run.poll() is not None:
                raise AssertionError("it is over")
            victim.send_signal(number)
        except (AssertionError, psutil.Error) as error:
            raise NotReached(f"{error or type(error).__name__}") from error
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
        return Outcome(HANGS_S, wrong=["it hangs"])
    said = " ".join(said.split())
    outcome = Outcome(time.monotonic() - began, said)
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
    if inspection_as_json(inspected(kept))["complete"]:
        outcome.wrong.append("said to be complete")
    interrupted = (fault.victim == LAUNCHER and fault.how != "kill") or may_go_on(fault)
    told = set(kept.ends) == {"plant", "controller"} and "interrupted" in kept.result.get(
        "fault", ""
    )
    if interrupted and not fault.starting and not told:  # the plant says so on the bus
        outcome.wrong.append("no ends, or no cause, in the recording")
    if "the recorder did not finish the file" in kept.problems and not fault.starting:
        outcome.lost_ms = max(0.0, 1e3 * (done_at - recording.stat().st_mtime))


def tried(fault: Fault, folder: Path) -> Outcome:
    """What came of a fault; a long loss is wrong on a machine that is not busy."""
    outcome = inflict(fault, folder)
    if outcome.lost_ms > MOST_LOST_MS:
        outcome.wrong.append(f"{outcome.lost_ms:.0f} ms are lost")
    return outcome


if __name__ == "__main__":
    sys.exit(series(__doc__, draw, tried, ("victim", "way")))
