"""Helpers that run hertzloop as a user does: as real processes."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import psutil

from hertzloop.bus.streams import ROLES
from tests.elastic_scenes import with_elastic_scenes
from tests.ports import free_ports

HERTZLOOP = [sys.executable, "-m", "hertzloop"]
# Long enough to be hit by a fault while it runs, far longer than a test waits.
LONG = ["aluminium-3mm", "--set", "run.duration_s=15"]
WELL_UNDER_WAY = 2_000_000  # bytes
EVENTUALLY_S = 120.0  # for what has to happen: generous, other processes may keep the cores busy


def hertzloop(*words: str, code: int = 0, **more: object) -> subprocess.CompletedProcess:
    """Run a command to its end, which must have an exit code. A shipped scene is its elastic
    copy."""
    done = python("-m", "hertzloop", *with_elastic_scenes(words), code=code, **more)
    assert "Traceback" not in done.stderr
    return done


def python(*words: object, code: int = 0, **more: object) -> subprocess.CompletedProcess:
    """Run Python with these arguments to its end, which must have an exit code."""
    done = subprocess.run(
        [sys.executable, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=2 * EVENTUALLY_S,
        **more,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done


def start(*words: str, **more: object) -> subprocess.Popen:
    """Start a command, which shows where it is when it is aborted. A shipped scene is its elastic
    copy."""
    command = [sys.executable, "-X", "faulthandler", *HERTZLOOP[1:], *with_elastic_scenes(words)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more
    )


class Bus:
    """Endpoints of a run in separate processes: each connects to those before it in `ROLES`."""

    def __init__(self, name: str) -> None:
        self.name = name
        ports = free_ports(len(ROLES))
        self.urls = {role: f"tcp/127.0.0.1:{port}" for role, port in zip(ROLES, ports, strict=True)}

    def words(self, role: str, wait_s: float = EVENTUALLY_S) -> list[str]:
        """Options of the process of a role."""
        before = [self.urls[other] for other in ROLES[: ROLES.index(role)]]
        connect = [word for url in before for word in ("--connect", url)]
        return ["--name", self.name, "--wait", str(wait_s), "--listen", self.urls[role], *connect]

    def start(self, role: str, *words: str, wait_s: float = EVENTUALLY_S) -> subprocess.Popen:
        """Start the process of a role."""
        return start("node", role, *words, *self.words(role, wait_s))


def finish(process: subprocess.Popen, timeout_s: float = EVENTUALLY_S) -> tuple[int, str]:
    """Exit code, and standard error in one line. Raises AssertionError with the stacks of a process
    that does not end."""
    try:
        _, err = process.communicate(timeout=timeout_s)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGABRT)
        process.send_signal(signal.SIGCONT)  # one that is stopped prints no stacks
        _, err = process.communicate(timeout=EVENTUALLY_S)
        raise AssertionError(f"not ended within {timeout_s} s: {process.args}\n{err}") from None
    return process.returncode, " ".join(err.split())


def ended(process: subprocess.Popen, code: int = 0, *words: str) -> str:
    """Standard error, in one line, of a process that must end with an exit code and these words."""
    found, err = finish(process)
    assert found == code, err
    assert "Traceback" not in err
    for word in words:
        assert word in err
    return err


@contextmanager
def killed_at_the_end(processes: Iterable[subprocess.Popen]) -> Iterator[None]:
    """None of the processes is left."""
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.communicate()


def next_line(process: subprocess.Popen, of: IO[str] | None = None) -> str:
    """The next line that a process prints, on its standard output if no other stream is given.
    Raises AssertionError where it prints none."""
    stream = of or process.stdout
    found: list[str] = []
    reader = threading.Thread(target=lambda: found.append(stream.readline()), daemon=True)
    reader.start()
    reader.join(EVENTUALLY_S)
    if not found:
        process.kill()
        raise AssertionError(f"printed no line within {EVENTUALLY_S} s: {process.args}")
    assert found[0], f"printed no further line, exit code {process.poll()}: {process.args}"
    return found[0]


def child_of(process: subprocess.Popen, command: str) -> psutil.Process:
    """The child process of a `hertzloop run` that runs `command` ("plant", "recorder", ...)."""

    def look() -> psutil.Process | None:
        for child in psutil.Process(process.pid).children(recursive=True):
            try:
                # A title may stand in one string, with zero bytes after it.
                if command in " ".join(child.cmdline()).split():
                    return child
            except psutil.Error:
                continue
        return None

    return wait_for(look)


def wait_for(look: Callable, timeout_s: float = EVENTUALLY_S):  # type: ignore[no-untyped-def]
    """Poll until `look` returns something true."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        found = look()
        if found:
            return found
        time.sleep(0.02)
    raise AssertionError(f"nothing within {timeout_s} s")


def grown_to(path: Path, size: int) -> Callable[[], bool]:
    """Whether a file has reached a size: the run is well under way."""
    return lambda: path.exists() and path.stat().st_size >= size


def leftovers(path: Path) -> list[str]:
    """Processes that still mention a recording: there must be none after a run."""
    found = []
    for process in psutil.process_iter(["cmdline", "pid"]):
        words = process.info["cmdline"] or []
        if process.info["pid"] != os.getpid() and any(str(path) in word for word in words):
            found.append(" ".join(words))
    return found
