"""`hertzloop law test` against real controller processes: ours, the example, broken ones."""

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from hertzloop.bus.port import PeerLost
from hertzloop.bus.streams import PLANT, Envelope, decoded
from hertzloop.loop.compiled import simulate
from hertzloop.plant import time_series as ts
from hertzloop.processes.conformance import Checks, ScriptedPlant, scripts
from hertzloop.recordings.reader import read
from hertzloop.setup import parse
from tests.hertzloop.lanes import QueuePort
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


def conformance(command: str, *words: str) -> tuple[int, str]:
    """Exit code and what was said, in one line."""
    # Nothing is timed, but where a controller is silent: it says when it ends that wait.
    patient = [] if "--timeout" in words else ["--timeout", "60"]
    wanted = ("law", "test", "--controller", command, "--wait", "120", *patient, *words)
    done = hertzloop(*wanted, timeout_s=800.0)
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, words_of(done.stdout + done.stderr)


@pytest.mark.full
@pytest.mark.parametrize("law", ["slope_threshold", "velocity_feedback"])
def test_our_own_controller_conforms(law: str) -> None:
    code, said = conformance(OURS, "--law", law)
    assert code == 0, said
    assert "conforms: " in said
    assert f"its law: {law}" in said


def test_the_example_conforms() -> None:
    code, said = conformance(EXAMPLE, "--law", "slope_threshold")
    assert code == 0, said
    assert "its law: own slope threshold 1.0" in said


RULES = {
    "no-run-id": "stream 'force' sequence 0 has no field run_id",
    "another-run": "stream 'force' sequence 3 belongs to run 7",
    "no-step-ns": "stream 'force' sequence 2 has no field step_ns",
    "no-sequence": "repeat on stream 'force': sequence 0 came, 1 was expected",
    "gap": "gap on stream 'force': sequence 6 came, 4 was expected",
    "hole": "stream 'force' sequence 4 starts at step",
    "no-samples-seen": "waited 5 s for the answer to sample 0",
    "too-many-seen": "stream 'force' sequence 2 has samples_seen = 4, 3 were sent",
    "short": "stream 'force' sequence 2 ends before step 3; after 3 samples",
    "beyond-the-end": "stream 'force' sequence 0 reaches step 1002, the run has 160",
    "nan": "stream 'force' sequence 5 holds force_n = nan at step 6",
    "nan-level": "stream 'force' sequence 5 holds promise_level = nan",
    "late": "waited 5 s for the answer to sample 3 (step 3) from the controller: nothing came",
    "dies": "controller left the run; plant was waiting for the answer to sample 3",
    "fault": "ended with the fault 'out of force'",
    "wrong-count": "stream 'force' is incomplete: 160 messages with 3 samples were announced",
    "no-count-of-events": "the controller announced no count for stream 'events/controller'",
    "no-set-up": "the final message of the controller names no scene",
    "other-scene": "another scene: 'kappa = 2.0' where the plant announced 'kappa = 0.8'",
    "other-stiffness": "worked with a contact stiffness of 1 N/m^1.5",
    "no-role": "stream 'end/controller' sequence 0 has no field role",
    "no-end": "waited 5 s for the controller's end: nothing came",
    "rubbish": "malformed message on stream 'force' where sequence 2 was expected",
    "stranger": "is none that a controller of run 'hertzloop' takes",
    "exit-code": "the controller's process ended with exit code 4 after a run without fault",
    "runs-on": "the controller's process runs on",
}


@pytest.mark.full
@pytest.mark.parametrize("rule", RULES)
def test_a_broken_rule_is_named(rule: str) -> None:
    silent = "waited 5 s" in RULES[rule] or rule == "runs-on"
    words = ("--script", "touch", *(("--timeout", "5") if silent else ()))
    code, said = conformance(f"{BROKEN} {rule} {PLACES}", *words)
    assert code == 1, said
    assert said.startswith("script 'touch': ")
    assert RULES[rule] in said
    assert "conforms" not in said


@pytest.mark.full
@pytest.mark.parametrize(
    ("rule", "words", "sentence"),
    [
        ("breaks-promise", "--script touch", "sequence 1 breaks the promise of zero force: 2.5 N"),
        ("next-bit", "--script bounce --law slope_threshold", "of law 'slope_threshold'"),
        ("by-the-cut", "--script touch", "the horizon changes no force"),
        ("silent-about-fault", "--script fault", "the controller's end has none"),
        ("stays", "--script death --timeout 5", "still there 5 s after the plant has died"),
        ("hasty", "--script late-recorder", "gap on stream 'force': sequence"),
        ("parts-early", "--script late-end", "without fault: plant or recorder left the run"),
    ],
)
def test_a_broken_rule_of_a_script(rule: str, words: str, sentence: str) -> None:
    """Each is broken at the script that shows it."""
    code, said = conformance(f"{BROKEN} {rule} {PLACES}", *words.split())
    assert code == 1, said
    assert sentence in said


def test_a_controller_that_cannot_be_started_or_does_not_stay() -> None:
    code, said = conformance("no-such-program-here {name}")
    assert code == 2
    assert "'no-such-program-here {name}': cannot be started" in said
    code, said = conformance(f"{sys.executable} -c 1/0")
    assert code == 1
    assert "did not connect (its process ended with exit code 1: ZeroDivisionError" in said


@pytest.mark.full
@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("--script nothing", "--script = 'nothing': unknown script. Use one of touch, bounce"),
        ("--law nonsense", "controller.law = 'nonsense': unknown law"),
        ("--law off --expect README.md", "cannot be combined"),
        ("--expect README.md", "README.md"),
    ],
)
def test_mistakes(words: str, sentence: str) -> None:
    done = hertzloop("law", "test", "--controller", "true", *words.split(), cwd=ROOT)
    assert done.returncode == 2
    assert sentence in " ".join(done.stderr.split())


@pytest.mark.full
def test_one_that_runs_already(tmp_path: Path) -> None:
    """It plays one script, and has to be there for it."""
    base = free_ports(3, in_a_row=True)[0]
    bus = ["--name", "running", "--listen", f"tcp/127.0.0.1:{base + 1}"]
    controller = start("node", "controller", *bus, "--connect", f"tcp/127.0.0.1:{base}")
    words = ("--name", "running", "--port", str(base), "--script", "saturation")
    done = hertzloop("law", "test", *words, "--law", "slope_threshold")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "conforms: " in done.stdout
    assert finish(controller)[0] == 0
    done = hertzloop("law", "test", *words, "--wait", "1")
    assert done.returncode == 1
    assert "no controller connected to bus 'running' within 1 s" in done.stdout


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
    assert forces.tobytes() == simulate(parse(scene)).rows[ts.F_A].tobytes()


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


class TestARecording:
    """Its samples are played, its forces are expected."""

    GOLDEN = ROOT / "recordings" / "golden" / "first-impact-2us-late.mcap"

    @pytest.mark.full
    def test_of_the_same_law(self) -> None:
        code, said = conformance(EXAMPLE + "", "--expect", str(self.GOLDEN))
        assert code == 0, said

    def test_of_another_law(self) -> None:
        rule = f"{BROKEN} next-bit {PLACES}"
        code, said = conformance(rule, "--expect", str(self.GOLDEN))
        assert code == 1
        first = int(np.flatnonzero(read(self.GOLDEN).force.arrays["force_n"])[0])
        assert f"the force of step {first} is " in said
        assert f"of {self.GOLDEN}" in said


def test_the_scripts_show_what_they_are_for() -> None:
    played = {script.name: script for script in scripts("slope_threshold")}
    assert all(np.any(script.expected) for script in played.values())
    saturation = played["saturation"]
    assert set(saturation.clipped) == {0, 1}
    assert saturation.samples.dtype.kind == "i"
    third = played["every-third"]
    assert third.setup.every_steps == 3
    assert third.setup.steps % 3
    touching = played["bounce"].samples < 0
    assert np.count_nonzero(np.diff(touching.astype(int)) == 1) == 4
    assert {script.ending for script in played.values()} == {"whole", "fault", "death"}


def test_samples_of_a_script_are_said_as_a_plant_says_them() -> None:
    """Codes with a flag each, values without."""
    kinds = set()
    for script in scripts("slope_threshold"):
        said: list[Envelope] = []
        port: Any = QueuePort(PLANT, said)  # which nobody answers
        plant = ScriptedPlant(script, port, None, 0.0, Checks())
        with pytest.raises(PeerLost, match="the answer to sample 0"):
            plant.play()
        [daq] = [decoded(envelope) for envelope in said if envelope.stream == "daq"]
        [(kind, samples)] = [(k, array) for k, array in daq.arrays.items() if len(array)]
        kinds.add(kind)
        assert samples.tolist() == script.samples[: len(samples)].tolist()
        flags = script.clipped[: len(samples)].tobytes() if kind == "code" else b""
        assert daq.header.saturated == flags
    assert kinds == {"code", "value"}


def test_blocks_of_a_script_are_as_small_as_a_plants(monkeypatch: pytest.MonkeyPatch) -> None:
    """A controller that promises no force gets the samples in blocks, too."""
    [script, *_] = [one for one in scripts("slope_threshold") if one.ending == "whole"]
    setup = script.setup.vary({"run.duration_s": 0.0253, "sensors.every_steps": 1})
    count = setup.steps
    script = replace(script, setup=setup, samples=np.ones(count), clipped=np.zeros(count, np.uint8))
    said: list[Envelope] = []
    port: Any = QueuePort(PLANT, said)
    plant = ScriptedPlant(script, port, None, 0.0, Checks())
    plant.promised, plant.level, plant.zero_end = True, -np.inf, count
    monkeypatch.setattr(plant, "_hear_answers", lambda _: None)
    monkeypatch.setattr(plant, "_hear_end", lambda: None)
    plant.play()
    blocks = [decoded(envelope) for envelope in said if envelope.stream == "daq"]
    assert [len(block.arrays["value"]) for block in blocks] == [10_000, 10_000, count - 20_000]


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
