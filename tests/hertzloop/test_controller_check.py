"""`hertzloop law test` against real controller processes: ours, the example, broken ones."""

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant import time_series as ts
from hertzloop.recordings.reader import read
from hertzloop.scene.setup import parse
from tests.hertzloop.processes import finish, hertzloop, start
from tests.ports import free_ports

ROOT = Path(__file__).parents[2]
PLACES = "--name {name} --listen {listen} --connect {connect}"
OURS = f"{sys.executable} -m hertzloop node controller {PLACES}"
EXAMPLE = f"{sys.executable} {ROOT / 'docs' / 'examples' / 'own_controller.py'} {PLACES}"
BROKEN = f"{sys.executable} {ROOT / 'tests' / 'hertzloop' / 'broken_controller.py'}"


@pytest.fixture(scope="module", autouse=True)
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The messages as the example wants them, where its process finds them."""
    folder = tmp_path_factory.mktemp("messages")
    shutil.copy(ROOT / "bus" / "messages.proto", folder)
    words = ["-m", "grpc_tools.protoc", "-I.", "--python_out=.", "messages.proto"]
    subprocess.run([sys.executable, *words], cwd=folder, check=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
        yield


def start_other(command: str) -> subprocess.Popen:
    """Start a process that is not ours."""
    return subprocess.Popen(
        shlex.split(command), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def words_of(text: str) -> str:
    """A text in one line."""
    return " ".join(text.split())


def checked(command: str, *words: str) -> tuple[int, str]:
    """Exit code of `law test` and what was said, in one line."""
    # Nothing is timed, but where a controller is silent: it says when it ends that wait.
    patient = [] if "--timeout" in words else ["--timeout", "60"]
    done = hertzloop("law", "test", "--controller", command, *patient, *words)
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, words_of(done.stdout + done.stderr)


@pytest.mark.full
@pytest.mark.parametrize("law", ["slope_threshold", "velocity_feedback"])
def test_our_own_controller_conforms(law: str) -> None:
    code, said = checked(OURS, "--law", law)
    assert code == 0, said
    assert "conforms: 4 runs, 10,000 forces" in said
    assert f"its law: {law}" in said


def test_the_example_conforms() -> None:
    code, said = checked(EXAMPLE, "--law", "slope_threshold")
    assert code == 0, said
    assert "its law: own slope threshold 1.0" in said


RULES = {
    "no-run-id": "stream 'force' sequence 0 belongs to run 0, not to",
    "another-run": "stream 'force' sequence 3 belongs to run 7, not to",
    "no-step-ns": "stream 'force' sequence 2 has steps of 0 ns",
    "no-sequence": "repeat on stream 'force': sequence 0 came, 1 was expected",
    "gap": "gap on stream 'force': sequence 6 came, 4 was expected",
    "twice": "repeat on stream 'force': sequence 4 came, 5 was expected",
    "hole": "stream 'force' sequence 4 starts at step",
    "too-many-seen": "sequence 2 answers 1003 samples, 1002 were sent",
    "short": "stream 'force' sequence 3 starts at step 1003, expected 1002",
    "beyond-the-end": "sequence 0 reaches step 3002, the run has 2500",
    "nan": "stream 'force' sequence 5 holds force_n = nan",
    "nan-level": "stream 'force' sequence 5 holds promise_level = nan",
    "late": "controller does not respond; plant waited 5 s for the force for step",
    "dies": "failed with exit code 3",
    "fault": "the controller ended the run: out of force",
    "wrong-count": "stream 'force' is incomplete",
    "no-count-of-events": "the controller announced no count for stream 'events/controller'",
    "no-set-up": "the final message of the controller names no scene",
    "other-scene": "another scene: 'kappa = 2.0' where the plant announced 'kappa = 0.8'",
    "other-stiffness": "worked with a contact stiffness of 1 N/m^1.5",
    "no-role": "stream 'end/controller' carries the end of ''",
    "rubbish": "malformed message on stream 'force' where sequence 2 was expected",
    "exit-code": "failed with exit code 4",
    "by-the-cut": "a horizon of 100 steps: the controller's force of step",
}


@pytest.mark.full
@pytest.mark.parametrize("rule", RULES)
def test_a_broken_rule_is_named(rule: str) -> None:
    code, said = checked(f"{BROKEN} {rule} {PLACES}", "--timeout", "5" if rule == "late" else "60")
    assert code == 1, said
    assert RULES[rule] in said
    assert said.count("error:") == 1
    assert "conforms" not in said


def test_a_wrong_force_is_named() -> None:
    code, said = checked(f"{BROKEN} next-bit {PLACES}", "--law", "slope_threshold")
    assert code == 1, said
    assert said.startswith("error: ideal sensor: the controller's force of step ")
    assert "that of law 'slope_threshold' is" in said


def test_a_controller_that_cannot_be_started_or_does_not_stay() -> None:
    code, said = checked("no-such-program-here {name}")
    assert code == 2
    assert "'no-such-program-here {name}': cannot be started" in said
    code, said = checked(f"{sys.executable} -c 1/0")
    assert code == 1
    assert "failed with exit code 1: ZeroDivisionError" in said


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--controller", "true", "--law", "nonsense"], "controller.law = 'nonsense': unknown law"),
        (["--law", "off"], "--controller: missing. Give the command line of your program."),
    ],
)
def test_mistakes(words: list[str], sentence: str) -> None:
    done = hertzloop("law", "test", *words)
    assert done.returncode == 2
    assert sentence in words_of(done.stderr)


def run_with(command: str, folder: Path, *words: str) -> subprocess.CompletedProcess:
    """`hertzloop run` with a program of the user's as its controller."""
    short = ("--set", "run.duration_s=0.0016", "--set", "run.accuracy=0.1", "--overwrite")
    if "--port" not in words:
        words += ("--port", str(free_ports(3, in_a_row=True)[0]))
    return hertzloop("run", "aluminium-3mm", *short, "--controller", command, *words, cwd=folder)


def test_a_run_has_a_program_as_its_controller(tmp_path: Path) -> None:
    done = run_with(EXAMPLE, tmp_path, "--out", "own.mcap", "--timeout", "60")
    assert done.returncode == 0, done.stderr
    assert "Law: own slope threshold 1.0 (the scene says slope_threshold)" in words_of(done.stdout)
    forces = read(tmp_path / "own.mcap").force.arrays["force_n"]
    assert np.any(forces)
    scene = read(tmp_path / "own.mcap").scene_toml
    assert forces.tobytes() == simulate(parse(scene)).truth[ts.F_A].tobytes()


@pytest.mark.full
@pytest.mark.parametrize(
    ("command", "code", "sentence"),
    [
        ("false", 1, "controller ('false') failed with exit code 1: no message"),
        ("true", 1, "controller ('true') ended before the run began"),
        (f"{sys.executable} -c 1/0", 1, "failed with exit code 1: ZeroDivisionError"),
        ("sh -c 'sleep 0.3; kill -9 $$'", 1, "was killed by SIGKILL"),
        ("no-such-program-here", 2, "cannot be started: no such program"),
        ("sh 'x", 2, "No closing quotation. Close the quotation."),
        ("sh {connect}", 2, "has one of {listen} and {connect}. Use both, or none"),
        (f"{BROKEN} rubbish {PLACES}", 1, "malformed message on stream 'force'"),
        (f"{BROKEN} dies {PLACES}", 1, "controller ("),
    ],
)
def test_a_program_that_fails_is_named(
    tmp_path: Path, command: str, code: int, sentence: str
) -> None:
    done = run_with(command, tmp_path, "--timeout", "60")
    assert done.returncode == code, done.stderr
    assert sentence in words_of(done.stderr)


@pytest.mark.full
def test_a_program_ends_with_the_run(tmp_path: Path) -> None:
    base, pid = free_ports(3, in_a_row=True)[0], tmp_path / "pid"
    stays = f"""sh -c "echo $$ > {pid}; {EXAMPLE}; sleep 500" """
    done = run_with(stays, tmp_path, "--timeout", "60", "--port", str(base))
    assert done.returncode == 0, done.stderr
    assert not psutil.pid_exists(int(pid.read_text()))


@pytest.mark.full
def test_the_example_gives_the_shipped_laws_bytes(tmp_path: Path) -> None:
    """Plant and recorder are ours, the controller is not."""
    scene = ["aluminium-3mm", "--set", "run.duration_s=0.0025", "--set", "run.accuracy=0.1"]
    urls = [f"tcp/127.0.0.1:{port}" for port in free_ports(3)]
    ours, theirs = tmp_path / "ours.mcap", tmp_path / "theirs.mcap"
    assert hertzloop("run", *scene, "--out", str(ours)).returncode == 0
    bus = ["--name", "own", "--wait", "40"]
    meet = [w for url in urls[:2] for w in ("--connect", url)]
    recorder = start("node", "recorder", "--out", str(theirs), *bus, "--listen", urls[2], *meet)
    plant = start("node", "plant", *scene, *bus, "--listen", urls[0])
    command = EXAMPLE.format(name="own", listen=urls[1], connect=urls[0])
    controller = start_other(command)
    said = [finish(process) for process in (plant, recorder, controller)]
    assert [code for code, _, _ in said] == [0, 0, 0], said
    mine, other = read(ours), read(theirs)
    assert not other.problems
    for stream in ("daq", "force", "truth"):
        one, two = getattr(mine, stream), getattr(other, stream)
        assert set(one.arrays) == set(two.arrays)
        assert one.samples == two.samples
        for name in one.arrays:
            assert one.arrays[name].tobytes() == two.arrays[name].tobytes(), name
    assert np.any(other.force.arrays["force_n"])
    done = hertzloop("inspect", str(theirs))
    assert done.returncode == 0
    assert "Law: own slope threshold 1.0 (the scene says slope_threshold)" in " ".join(
        done.stdout.split()
    )
