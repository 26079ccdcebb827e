"""The launcher waits for nobody without end, whatever a process of the run does."""

import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES
from hertzloop.loop.run_options import RunOptions
from hertzloop.processes import launcher as launchers
from hertzloop.processes.child_process import ChildProcess
from hertzloop.processes.launcher import Launcher, RunFailed
from tests.hertzloop.commands import EVENTUALLY_S
from tests.hertzloop.short_runs import scene

# Programs that report one thing each.
DONE = "say({'done': {'wall_s': 0.0}})"
STAYS = "say({'ready': True}); time.sleep(600)"
SAY = "import json, time\ndef say(report): print(json.dumps(report), flush=True)\n"


@pytest.fixture(autouse=True)
def bounded():
    """A launcher that waits for ever fails the test instead of keeping it."""
    timer = threading.Timer(EVENTUALLY_S, signal.pthread_kill, [threading.main_thread().ident, 2])
    timer.start()
    yield
    timer.cancel()


def waiting_for(folder: Path, programs: dict[str, str]) -> Launcher:
    """A launcher with these programs as its processes."""
    launcher = Launcher(scene(), folder / "run.mcap", RunOptions(timeout_s=0.1), wait_s=0.1)
    for role, program in programs.items():
        process = subprocess.Popen(
            [sys.executable, "-c", SAY + program],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        child = ChildProcess(role, process, folder / role)
        launcher.children.append(child)
        threading.Thread(target=launcher._listen, args=(child,), daemon=True).start()
    return launcher


@pytest.mark.parametrize(
    ("patience", "programs", "sentence"),
    [
        (
            {"_LEAVE_S": 0.5},
            {PLANT: STAYS, CONTROLLER: DONE, RECORDER: DONE},
            "^plant does not respond; the others had ended",
        ),
        pytest.param(
            {},
            dict.fromkeys(ROLES, STAYS),
            "^controller and plant and recorder do not respond; the launcher has received nothing",
            marks=pytest.mark.full,
        ),
    ],
)
def test_one_that_does_not_end_is_named(patience, programs, sentence, tmp_path, monkeypatch):
    for name, seconds in patience.items():
        monkeypatch.setattr(launchers, name, seconds)
    launcher = waiting_for(tmp_path, programs)
    try:
        with pytest.raises(RunFailed, match=sentence):
            launcher.wait()
    finally:
        launcher._end_all()
    assert all(child.process.poll() is not None for child in launcher.children)


def test_processes_of_roles_that_are_done_keep_nobody(tmp_path):
    launcher = waiting_for(tmp_path, dict.fromkeys(ROLES, DONE + "; time.sleep(600)"))
    try:
        launcher.wait()
    finally:
        launcher._end_all()
    assert all(child.process.poll() is not None for child in launcher.children)
