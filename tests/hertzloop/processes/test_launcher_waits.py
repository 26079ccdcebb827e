"""The launcher waits for nobody without end, whatever a process of the run does."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES
from hertzloop.loop.run_options import RunOptions
from hertzloop.processes import launcher as launchers
from hertzloop.processes.child_process import Report, start_role
from hertzloop.processes.launcher import Launcher, RunFailed
from hertzloop.processes.signals import deferred
from tests.hertzloop.commands import EVENTUALLY_S
from tests.hertzloop.short_runs import scene


def does(report: Report, *wanted: str) -> dict[str, Any]:
    """Be ready, stay, or both."""
    if "ready" in wanted:
        report(ready=True)
    if "done" in wanted:
        report(done={"wall_s": 0.0})
    if "stays" in wanted:
        time.sleep(600)
    return {"wall_s": 0.0}


@pytest.fixture(autouse=True)
def bounded():
    """A launcher that waits for ever fails the test instead of keeping it."""
    timer = threading.Timer(EVENTUALLY_S, signal.pthread_kill, [threading.main_thread().ident, 2])
    timer.start()
    yield
    timer.cancel()


@contextmanager
def waiting_for(
    folder: Path, works: dict[str, tuple[str, ...]], silence_s: float = EVENTUALLY_S
) -> Iterator[Launcher]:
    """A launcher whose processes do this; it leaves none of them behind."""
    launcher = Launcher(scene(), folder / "run.mcap", RunOptions())
    launcher._silence_s = silence_s
    with deferred():
        for role, wanted in works.items():
            title = f"hertzloop {role}"
            launcher.children.append(start_role(role, folder / role, title, does, *wanted))
    try:
        yield launcher
    finally:
        launcher._end_all()
    assert not multiprocessing.active_children()


@pytest.mark.parametrize(
    ("silence_s", "works", "sentence"),
    [
        (
            EVENTUALLY_S,
            {PLANT: ("ready", "stays"), CONTROLLER: (), RECORDER: ()},
            "^plant does not respond; the others had ended",
        ),
        (
            0.5,
            dict.fromkeys(ROLES, ("ready", "stays")),
            "^controller and plant and recorder do not respond; the launcher has received nothing",
        ),
    ],
)
def test_one_that_does_not_end_is_named(silence_s, works, sentence, tmp_path, monkeypatch):
    monkeypatch.setattr(launchers, "_LEAVE_S", 2.0)
    with (
        waiting_for(tmp_path, works, silence_s) as launcher,
        pytest.raises(RunFailed, match=sentence),
    ):
        launcher.wait()


@pytest.mark.full
def test_processes_of_roles_that_are_done_keep_nobody(tmp_path):
    with waiting_for(tmp_path, dict.fromkeys(ROLES, ("done", "stays"))) as launcher:
        launcher.wait()


def test_a_process_with_threads_starts_its_roles_afresh(tmp_path):
    """A fork would copy locks that another thread holds."""
    threads = len(os.listdir("/proc/self/task"))
    assert threads > 1  # of the timer
    with waiting_for(tmp_path, dict.fromkeys(ROLES, ())) as launcher:
        assert launcher.wait() == {"wall_s": 0.0}
