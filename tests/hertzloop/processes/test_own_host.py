"""A run on a host that has other users: nothing of it can be reached by them."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from hertzloop.recordings.reader import read
from tests.hertzloop.commands import (
    EVENTUALLY_S,
    LONG,
    child_of,
    finish,
    grown_to,
    start,
    wait_for,
)

NOBODY = 65534
ROLES = ("plant", "controller", "recorder")
UNDER_WAY = 200_000  # bytes


@pytest.fixture
def going(tmp_path: Path) -> Iterator[tuple[subprocess.Popen, dict[str, psutil.Process]]]:
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
    done = subprocess.run(
        [sys.executable, "-m", "tests.hertzloop.processes.other_user", str(user), name, *endpoints],
        capture_output=True, text=True, timeout=EVENTUALLY_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    refused, took_part = json.loads(done.stdout)
    return refused, took_part


def test_nothing_listens_on_any_network(
    going: tuple[subprocess.Popen, dict[str, psutil.Process]],
) -> None:
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
def test_another_user_gets_neither_samples_nor_a_say(
    going: tuple[subprocess.Popen, dict[str, psutil.Process]], tmp_path: Path
) -> None:
    run, children = going
    endpoints = [
        f"unixsock-stream/{held}" for child in children.values() for held in sockets_of(child)
    ]
    words = " ".join(children["plant"].cmdline()).split()
    name = words[words.index("--name") + 1]
    assert as_user(NOBODY, endpoints, name) == (["PermissionError"] * 3, False)
    assert all(child.is_running() for child in children.values())
    assert as_user(0, endpoints, name) == ([], True)  # the same could be heard by its own user
    code, err, _ = finish(run)
    assert code == 1, err  # and end the run
    assert read(tmp_path / "run.mcap").problems


def test_a_killed_launcher_leaves_no_sockets(
    going: tuple[subprocess.Popen, dict[str, psutil.Process]],
) -> None:
    run, children = going
    [held] = sockets_of(children["plant"])
    folder = held.parent
    assert folder.is_dir()
    run.kill()
    wait_for(lambda: not folder.exists())
