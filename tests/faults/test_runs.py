"""A short series of faults in runs, and what judges them; long ones: see `tests.faults.runs`."""

import itertools
import random
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hertzloop.processes.child_process import ChildProcess
from hertzloop.processes.failure_cause import failure_cause
from tests.faults import runs
from tests.faults.inflict import (
    CLOSED,
    COMMANDS,
    LAUNCHER,
    SIGNALS,
    Fault,
    NotUnderWay,
    Outcome,
    draw,
    inflict,
    wrong_words,
)
from tests.faults.page import PAGE, put
from tests.faults.runs import MOST_LOST_MS, table
from tests.recordings.damages import Tally
from tests.tiers import default

FAULTS = [
    Fault("controller", "kill", "lane", False, 0.0),
    Fault(LAUNCHER, "interrupt", "lane", False, 0.0),
    Fault(LAUNCHER, "kill", "lane", False, 0.1),
    Fault("plant", "kill", "lane", False, 0.0),
    Fault("recorder", "kill", "lane", False, 0.3),
    *(Fault(role, "kill", "lane", True, 0.0) for role in COMMANDS),
    Fault("recorder", "interrupt", "lane", True, 0.0),
    Fault("controller", "stop", "lane", False, 0.0),
    Fault("recorder", "stop", "lane", False, 0.0),
    *(Fault(LAUNCHER, how, "lane", False, 0.0) for how in ("terminate", *CLOSED)),
    Fault("plant", "pause", "no lane", False, 0.2, 0.5),
    # The recorder's last block is older than the controller's wait, which knows the cause.
    Fault("plant", "long pause", "lane", False, 0.235, 6.2),
    Fault("recorder", "long pause", "no lane", False, 0.0, 6.2),
]


@pytest.mark.usefixtures("warm_kernels")
@pytest.mark.parametrize("fault", default(FAULTS, FAULTS[:3]), ids=str)
def test_faults(fault: Fault) -> None:
    # Not in tmp_path: its path is too long for sockets.
    with tempfile.TemporaryDirectory() as folder:
        outcome = inflict(fault, Path(folder))
    assert outcome.wrong == [], outcome
    recorder = fault.victim == "recorder" and not fault.starting
    assert outcome.lost_ms == 0 or recorder, outcome
    assert outcome.lost_ms > 0 or not (recorder and fault.how == "kill"), outcome
    assert outcome.seconds < 60, outcome  # far from for ever, on a busy machine, too


def test_every_fault_is_drawn() -> None:
    random_ = random.Random(1)
    drawn = {(f.victim, f.how, f.lane) for f in (draw(random_) for _ in range(2000))}
    assert len(drawn) == 2 * (len(COMMANDS) * len(SIGNALS) + len(SIGNALS) - 2)


@pytest.mark.parametrize(
    ("victim", "how", "code", "said", "wrong"),
    [
        ("plant", "kill", 1, "error: plant was killed by SIGKILL", ""),
        ("plant", "kill", 1, "error: recorder was killed by SIGKILL", "another cause"),
        ("plant", "kill", 0, "error: plant was killed by SIGKILL", "exit code 0"),
        ("plant", "stop", 1, "controller does not respond", "another cause"),
        ("plant", "kill", 1, "Traceback plant was killed by SIGKILL", "a traceback"),
        ("plant", "long pause", 1,
         "plant waited 4 s for the force from the controller: nothing came", "another cause"),
        ("controller", "long pause", 1,
         "plant waited 4 s for the force from the controller: nothing came", ""),
        ("plant", "pause", 1, "plant does not respond", "exit code 1"),
        (LAUNCHER, "terminate", 130, "interrupted; the recording", ""),
        (LAUNCHER, "terminate", -15, "", "exit code -15"),
    ],
)  # fmt: skip
def test_a_wrong_cause_is_found(victim: str, how: str, code: int, said: str, wrong: str) -> None:
    assert wrong_words(Fault(victim, how, "lane", False, 0.0), code, said) == wrong


def test_the_table_counts() -> None:
    good, bad = Outcome("", 3.0), Outcome("", 9.0, MOST_LOST_MS + 1, ["another cause", "it hangs"])
    fault = Fault("plant", "kill", "lane", False, 0.0)
    said = table([fault] * 6, {0: good, 5: bad} | dict.fromkeys(range(1, 5)))
    assert "tries, lane | tries, no lane | hangs | wrong cause | most lost, ms | longest, s" in said
    assert "| plant | 2 | 0 | 1 | 1 | 101 | 9 |" in said
    assert "2 tries: something is wrong after 1, more than 100 ms are lost after 1." in said
    assert "In no try: processes left, unreadable, wrong exit code, otherwise wrong. 4 " in said


def test_a_series_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    done: list[Fault] = []
    numbers = itertools.count(1)  # one for each thread that asks

    def once(fault: Fault, folder: Path) -> Outcome:
        done.append(fault)
        number = next(numbers)
        if number == 2:
            raise NotUnderWay("it is over")
        return Outcome("ended", 1.0, 2.0, ["it hangs"] if number == 4 else [])

    def series(tries: int, seed: int = 5) -> int:
        words = ["runs", "--tries", str(tries), "--seed", str(seed), "--results", str(results)]
        monkeypatch.setattr(sys, "argv", [*words, "--at-once", "2"])
        return runs.main()

    results = tmp_path / "results.jsonl"
    monkeypatch.setattr(runs, "inflict", once)
    assert series(3) == 0
    assert len(done) == 3
    assert series(3) == 0  # nothing is left to do
    assert series(8) == 1
    said = capsys.readouterr()
    assert "7 tries: something is wrong after 1, more than 100 ms are lost after 0." in said.out
    assert "it is over" in said.err
    assert "['it hangs']" in said.err
    random_ = random.Random(5)
    drawn = [draw(random_) for _ in range(8)]
    assert sorted(map(str, done)) == sorted(map(str, drawn))
    with pytest.raises(SystemExit):
        series(8, seed=6)
    assert "holds unfinished work with another seed" in capsys.readouterr().err


def ended(
    role: str, fault: str, *lost: str, others: bool = True, at_s: float = 0.0
) -> ChildProcess:
    process: Any = SimpleNamespace(returncode=1)
    return ChildProcess(
        role,
        process,
        Path("none"),
        ready=True,
        fault=fault,
        others=others,
        lost=list(lost),
        at_s=at_s,
    )


def test_who_gave_up_is_not_to_blame_for_leaving() -> None:
    """The controller paused for longer than the others wait, and lives again."""
    recorder = ended("recorder", "nothing from plant and controller", "plant", "controller")
    plant = ended("plant", "nothing from the controller", "controller")
    deceived = ended("plant", "the recorder left", "recorder")
    awake = ended("controller", "the plant left", "plant")
    told = ended("controller", "the plant ended the run")
    assert failure_cause([recorder, plant, awake], set()) == plant.fault
    assert failure_cause([plant, recorder, told], set()) == plant.fault
    assert failure_cause([told, plant, recorder], set()) == plant.fault
    assert failure_cause([recorder, deceived, awake], set()) == recorder.fault
    assert failure_cause([told], set()) == told.fault
    # The recorder paused; the plant waited for it, and the controller for the plant.
    waits = ended("controller", "nothing from the plant", "plant")
    blocked = ended("plant", "the recorder took nothing", "recorder")
    awake = ended("recorder", "the controller left", "controller")
    assert failure_cause([waits, blocked, awake], set()) == blocked.fault
    # The same, but the plant says nothing, since it still waits, and the recorder does not run.
    named = failure_cause([waits], {"plant", "recorder"}, {"recorder"})
    assert named == f"recorder does not respond; {waits.fault}"
    # The same, but who wakes up late ends first.
    blocked = ended("plant", "the recorder took nothing", "recorder", at_s=2.0)
    awake = ended("recorder", "the plant left", "plant", at_s=2.5)
    assert failure_cause([awake, blocked], set()) == blocked.fault
    own = ended("controller", "its own", others=False)
    assert failure_cause([recorder, plant, own], set()) == own.fault


def test_the_page_takes_the_tables(tmp_path: Path) -> None:
    """Each in its place, again and again; the page that is there has both, as they are now."""
    page, text = tmp_path / "faults.md", PAGE.read_text(encoding="utf-8")
    page.write_text(text, encoding="utf-8")
    for round_ in ("first", "second"):
        put("runs", "command", f"| {round_} |", page)
    written = page.read_text(encoding="utf-8")
    assert "`command`:\n\n| second |\n\n<!-- end of runs -->" in written
    assert "| first |" not in written
    put("runs", "command", "| first |", page)
    assert page.read_text(encoding="utf-8") == written.replace("| second |", "| first |")
    with pytest.raises(ValueError, match="has no place for 'wars'"):
        put("wars", "command", "", page)
    for heads in (table([], {}), Tally().table()):
        assert heads.splitlines()[0] in text
