"""Roles are forks of a server, and ordinary processes all the same."""

import os
import signal

import psutil
import pytest

from hertzloop.processes import fork_server
from tests.hertzloop.commands import EVENTUALLY_S, wait_for

pytestmark = pytest.mark.timeout(EVENTUALLY_S)  # a role that never ends fails its test


@pytest.fixture
def errors(tmp_path):
    return tmp_path / "stderr"


def servers() -> list[psutil.Process]:
    return [c for c in psutil.Process().children() if "fork" in " ".join(c.cmdline())]


def test_a_role_has_this_folder_and_environment(errors, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = []
    for columns in ("60", "200"):
        monkeypatch.setenv("COLUMNS", columns)
        role = fork_server.start(["run", "--help"], errors)
        said.append(role.stdout.read())
        assert role.wait() == 0, errors.read_text()
    assert len(said[0].splitlines()) > len(said[1].splitlines())
    assert fork_server.start(["law", "new", "mine.py"], errors).wait() == 0, errors.read_text()
    assert (tmp_path / "mine.py").exists()


def test_the_exit_code_and_the_error_are_those_of_the_command(errors):
    assert fork_server.start(["run", "no-such-scene"], errors).wait() == 2
    assert "no-such-scene" in errors.read_text()


def test_a_role_is_a_process_of_its_own_that_can_be_killed(errors):
    words = ["node", "recorder", "--out", str(errors.with_suffix(".mcap")), "--machine"]
    role = fork_server.start(words, errors)
    process = psutil.Process(role.pid)
    try:
        assert role.poll() is None
        assert wait_for(lambda: os.getsid(role.pid) == role.pid)
        role.send_signal(signal.SIGKILL)
        assert role.wait() == role.poll() == -signal.SIGKILL
        assert not process.is_running()
    finally:
        role.send_signal(signal.SIGKILL)


def test_a_role_ends_when_its_standard_input_does(errors):
    words = ["node", "recorder", "--out", str(errors.with_suffix(".mcap")), "--machine"]
    role = fork_server.start(words, errors)
    role.stdin.close()
    assert role.wait() != 0


@pytest.mark.full
def test_a_killed_server_is_replaced(errors):
    fork_server.start(["--version"], errors).wait()
    [server] = servers()
    server.kill()
    server.wait(60)
    role = fork_server.start(["--version"], errors)
    assert role.stdout.read().startswith("hertzloop ")
    assert role.wait() == 0
    assert len(servers()) == 1
