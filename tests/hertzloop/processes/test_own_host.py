"""A run on a host that has other users: nothing of it can be reached by them."""

import json
import os
import signal
from pathlib import Path

import psutil
import pytest

from hertzloop.recordings.reader import read
from tests.hertzloop.commands import (
    LONG,
    child_of,
    ended,
    finish,
    grown_to,
    python,
    start,
    wait_for,
)

NOBODY = 65534
ROLES = ("plant", "controller", "recorder")
UNDER_WAY = 200_000  # bytes


@pytest.fixture
def going(tmp_path):
    """A default run, well under way, and its processes."""
    recording = tmp_path / "run.mcap"
    run = start("run", *LONG, "--out", str(recording))
    try:
        children = {role: child_of(run, role) for role in ROLES}
        wait_for(grown_to(recording, UNDER_WAY))
        yield run, children
    finally:
        run.kill()
        run.communicate()


def sockets_of(process: psutil.Process) -> set[Path]:
    """The sockets with a name that a process listens at. Its title may be cut: the kernel gives it
    no more room than the launcher's command line and environment had."""
    return {Path(held.laddr) for held in process.net_connections("unix") if held.laddr}


def as_user(user: int, endpoints: list[str], name: str) -> tuple[list[str], bool]:
    """Errors of another user's connections, and whether he took part in the run at last."""
    program = "tests.hertzloop.processes.other_user"
    refused, took_part = json.loads(python("-m", program, user, name, *endpoints).stdout)
    return refused, took_part


def test_nothing_listens_on_any_network(going):
    run, children = going
    for process in (psutil.Process(run.pid), *children.values()):
        assert process.net_connections("inet") == [], process.cmdline()
    [folder] = {held.parent for child in children.values() for held in sockets_of(child)}
    assert folder.stat().st_mode & 0o777 == 0o700
    assert sorted(file.name for file in folder.iterdir() if file.is_socket()) == ["0", "1", "2"]
    run.send_signal(signal.SIGINT)
    finish(run)
    assert not folder.exists()


@pytest.mark.full
@pytest.mark.skipif(os.getuid() != 0, reason="only root can be another user, too")
def test_another_user_gets_neither_samples_nor_a_say(going, tmp_path):
    run, children = going
    endpoints = [
        f"unixsock-stream/{held}" for child in children.values() for held in sockets_of(child)
    ]
    words = " ".join(children["plant"].cmdline()).split()
    name = words[words.index("--name") + 1]
    assert as_user(NOBODY, endpoints, name) == (["PermissionError"] * 3, False)
    assert all(child.is_running() for child in children.values())
    assert as_user(0, endpoints, name) == ([], True)  # the same could be heard by its own user
    ended(run, 1)  # and end the run
    assert read(tmp_path / "run.mcap").problems
