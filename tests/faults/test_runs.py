"""A short series of faults in runs, and what judges them; long ones: see `tests.faults.runs`."""

import tempfile
from multiprocessing import Pipe, Process
from pathlib import Path

import pytest

from hertzloop.processes import child_process
from hertzloop.processes.child_process import ChildProcess, failure_cause
from tests.faults.runs import CLOSED, LAUNCHER, Fault, inflict
from tests.tiers import default

FAULTS = [
    Fault("controller", "kill", "shared memory", False, 0.0),
    Fault(LAUNCHER, "interrupt", "shared memory", False, 0.0),
    Fault(LAUNCHER, "kill", "shared memory", False, 0.1),
    Fault("recorder", "kill", "shared memory", False, 0.3),
    Fault("controller", "kill", "shared memory", True, 0.0),
    Fault("recorder", "interrupt", "shared memory", True, 0.0),
    Fault("controller", "stop", "shared memory", False, 0.0),
    *(Fault(LAUNCHER, how, "shared memory", False, 0.0) for how in CLOSED),
    Fault("plant", "pause", "bus", False, 0.2, 0.5),
    # The recorder's last block is older than the controller's wait, which knows the cause.
    Fault("plant", "long pause", "shared memory", False, 0.235, 6.2),
    # It is awake again when the launcher hears of the fault.
    Fault("controller", "long pause", "bus", False, 0.3, 8.0),
]


@pytest.mark.full
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


def ended(
    role: str, sentence: str, *lost: str, others: bool = True, at_s: float = 0.0
) -> ChildProcess:
    fault = child_process.RoleFault(sentence, others, lost, at_s)
    return ChildProcess(
        role, Process(name=role), Path("none"), Pipe()[0], ready=True, fault=fault, code=1
    )


def cause(*failed: ChildProcess, running: tuple[str, ...] = ()) -> str:
    going = [ChildProcess(role, Process(name=role), Path("none"), Pipe()[0]) for role in running]
    return failure_cause([*failed, *going])


def test_who_gave_up_is_not_to_blame_for_leaving():
    """The controller paused for longer than the others wait, and lives again."""
    plant = ended("plant", "nothing from the controller", "controller", at_s=1.0)
    recorder = ended("recorder", "nothing came", "plant", "controller", at_s=2.0)
    awake = ended("controller", "the plant left", "plant", at_s=2.5)
    told = ended("controller", "the plant ended the run", at_s=0.5)
    assert cause(recorder, plant, awake) == "nothing from the controller"
    assert cause(told, plant, recorder) == "nothing from the controller"
    assert cause(told) == "the plant ended the run"
    gap = ended("controller", "a gap in what it heard while it slept", others=False, at_s=3.0)
    assert cause(recorder, plant, gap) == "nothing from the controller"
    own = ended("controller", "its own", others=False, at_s=0.5)
    assert cause(recorder, plant, own) == "its own"
    own.fault = None
    own.code = -9
    assert cause(recorder, plant, own) == "controller was killed by SIGKILL"


def test_a_role_that_does_not_react_hangs():
    blocked = ended("plant", "nobody took a message", "recorder")
    told = ended("controller", "the plant ended the run")
    said = "recorder does not respond; nobody took a message"
    assert cause(blocked, told, running=("recorder",)) == said
    misses = ended("controller", "nothing from the plant", "plant", at_s=-1.0)
    assert cause(blocked, misses, running=("recorder",)) == said
