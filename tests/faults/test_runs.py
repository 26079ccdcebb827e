"""A short series of faults in runs, and what judges them; long ones: see `tests.faults.runs`."""

import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hertzloop.processes.child_process import ChildProcess
from hertzloop.processes.failure_cause import failure_cause
from tests.faults.inflict import (
    CLOSED,
    LAUNCHER,
    Fault,
    inflict,
    wrong_words,
)
from tests.tiers import default

FAULTS = [
    Fault("controller", "kill", "lane", False, 0.0),
    Fault(LAUNCHER, "interrupt", "lane", False, 0.0),
    Fault(LAUNCHER, "kill", "lane", False, 0.1),
    Fault("recorder", "kill", "lane", False, 0.3),
    Fault("controller", "kill", "lane", True, 0.0),
    Fault("recorder", "interrupt", "lane", True, 0.0),
    Fault("controller", "stop", "lane", False, 0.0),
    *(Fault(LAUNCHER, how, "lane", False, 0.0) for how in ("terminate", *CLOSED)),
    Fault("plant", "pause", "no lane", False, 0.2, 0.5),
    # The recorder's last block is older than the controller's wait, which knows the cause.
    Fault("plant", "long pause", "lane", False, 0.235, 6.2),
    Fault("recorder", "long pause", "no lane", False, 0.0, 6.2),
]


@pytest.mark.usefixtures("warm_kernels")
@pytest.mark.parametrize("fault", default(FAULTS, FAULTS[:1]), ids=str)
def test_faults(fault):
    # Not in tmp_path: its path is too long for sockets.
    with tempfile.TemporaryDirectory() as folder:
        outcome = inflict(fault, Path(folder))
    assert outcome.wrong == [], outcome
    recorder = fault.victim == "recorder" and not fault.starting
    assert outcome.lost_ms == 0 or recorder, outcome
    assert outcome.lost_ms > 0 or not (recorder and fault.how == "kill"), outcome
    assert outcome.seconds < 60, outcome  # far from for ever, on a busy machine, too


@pytest.mark.parametrize(
    ("victim", "how", "code", "said", "wrong"),
    [
        ("plant", "kill", 1, "error: plant was killed by SIGKILL", ""),
        ("plant", "kill", 1, "error: recorder was killed by SIGKILL", "another cause"),
        ("plant", "stop", 1, "controller does not respond", "another cause"),
        ("plant", "kill", 1, "Traceback plant was killed by SIGKILL", "a traceback"),
        (
            "controller",
            "long pause",
            1,
            "plant waited 4 s for the force from the controller: nothing came",
            "",
        ),
        (LAUNCHER, "terminate", -15, "", "exit code -15"),
    ],
)
def test_a_wrong_cause_is_found(victim, how, code, said, wrong):
    assert wrong_words(Fault(victim, how, "lane", False, 0.0), code, said) == wrong


def ended(
    role: str, fault: str, *lost: str, others: bool = True, at_s: float = 0.0
) -> ChildProcess:
    process: Any = SimpleNamespace(returncode=1)
    found = {"fault": fault, "others": others, "lost": list(lost), "at_s": at_s}
    return ChildProcess(role, process, Path("none"), ready=True, **found)


def test_who_gave_up_is_not_to_blame_for_leaving():
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
    # The same, but the plant says nothing.
    named = failure_cause([waits], {"plant", "recorder"})
    assert named == f"plant does not respond; {waits.fault}"
    # The same, but who wakes up late ends first.
    blocked = ended("plant", "the recorder took nothing", "recorder", at_s=2.0)
    awake = ended("recorder", "the plant left", "plant", at_s=2.5)
    assert failure_cause([awake, blocked], set()) == blocked.fault
    own = ended("controller", "its own", others=False)
    assert failure_cause([recorder, plant, own], set()) == own.fault
