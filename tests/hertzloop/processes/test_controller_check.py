"""`hertzloop law test` against real controller processes: ours, the example, broken ones."""

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant import time_series as ts
from hertzloop.recordings.reader import read
from hertzloop.scene.setup import parse
from tests.hertzloop.commands import EVENTUALLY_S, hertzloop
from tests.hertzloop.own_laws import EXAMPLES
from tests.ports import ports_in_a_row

PLACES = "--name {name} --listen {listen} --connect {connect}"
EXAMPLE = f"{sys.executable} {EXAMPLES / 'own_controller.py'} {PLACES}"
BROKEN = f"{sys.executable} {Path(__file__).with_name('broken_controller.py')}"


@pytest.fixture(scope="module", autouse=True)
def path_of_messages(messages):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(messages), prepend=os.pathsep)
        yield


def words_of(text: str) -> str:
    """A text in one line."""
    return " ".join(text.split())


def checked(*words: str, code: int = 0) -> str:
    """What `law test` said, in one line, when it has ended with an exit code."""
    # Nothing is timed, but where a controller is silent: it says when it ends that wait.
    patient = [] if "--timeout" in words else ["--timeout", "60"]
    done = hertzloop("law", "test", *patient, *words, code=code)
    return words_of(done.stdout + done.stderr)


def test_the_example_conforms():
    said = checked("--controller", EXAMPLE, "--law", "slope_threshold")
    assert "its law: own slope threshold 1.0" in said


def test_another_last_bit_is_named():
    command = f"{BROKEN} next-bit {PLACES}"
    said = checked("--controller", command, "--law", "slope_threshold", code=1)
    assert "error: ideal sensor: the controller's force of step " in said
    assert "fused multiply-add" in said


# The other guards: test_exchange_guards, and the checker of streams in tests/bus.
RULES = {
    "gap": "gap on stream 'force': sequence 6 came, 4 was expected",
    "late": "controller does not respond; plant waited 2.5 s for the force for step",
    "dies": "failed with exit code 3",
    "exit-code": "failed with exit code 4",
    "by-the-cut": "at most 100 steps between exchanges: the controller's force of step",
}


@pytest.mark.full
@pytest.mark.parametrize("rule", RULES)
def test_a_broken_rule_is_named(rule):
    wait_s = "2" if rule == "late" else "60"
    command = f"{BROKEN} {rule} {PLACES}"
    said = checked("--controller", command, "--timeout", wait_s, code=1)
    assert RULES[rule] in said
    assert said.count("error:") == 1
    assert "conforms" not in said


def run_with(command: str, folder: Path, *words: str, code: int = 0) -> subprocess.CompletedProcess:
    """`hertzloop run` with a program of the user's as its controller."""
    short = ("--set", "run.duration_s=0.0016", "--set", "run.accuracy=0.1", "--timeout", "60")
    base = str(ports_in_a_row(3)[0])
    words = ("--controller", command, *short, "--port", base, *words)
    return hertzloop("run", "aluminium-3mm", *words, cwd=folder, code=code)


@pytest.mark.full
def test_a_run_has_a_program_as_its_controller(tmp_path):
    done = run_with(EXAMPLE, tmp_path, "--out", "own.mcap")
    assert "Law: own slope threshold 1.0 (the scene says slope_threshold)" in words_of(done.stdout)
    found = read(tmp_path / "own.mcap")
    ours = simulate(parse(found.scene_toml))
    assert np.any(ours.truth[ts.F_A])
    assert found.force.arrays["force_n"].tobytes() == ours.truth[ts.F_A].tobytes()
    assert found.truth.arrays["xi_m"].tobytes() == ours.truth[ts.XI].tobytes()


@pytest.mark.full
@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("true", "controller ('true') ended before the run began"),
        (f"{sys.executable} -c 1/0", "exit code 1: ZeroDivisionError"),
        ("sh -c 'sleep 0.3; kill -9 $$'", "was killed by SIGKILL"),
    ],
)
def test_a_program_that_fails_is_named(tmp_path, command, sentence):
    assert sentence in words_of(run_with(command, tmp_path, code=1).stderr)


@pytest.mark.full
def test_a_program_ends_with_the_run(tmp_path):
    pid = tmp_path / "pid"
    stays = f"""sh -c "echo $$ > {pid}; {EXAMPLE}; sleep 500" """
    run_with(stays, tmp_path)
    with suppress(psutil.NoSuchProcess):  # a killed process is there until somebody asks for it
        psutil.Process(int(pid.read_text())).wait(EVENTUALLY_S)
