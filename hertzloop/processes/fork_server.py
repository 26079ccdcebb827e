"""Start the roles of a run as forks of one process that has imported everything.

The server is itself a fork of the launcher, before that has a second thread and a zenoh session, so
it is safe to fork. Every role becomes an ordinary process with its own session, working directory,
environment and standard streams.

With the fork server of `multiprocessing` and the same modules preloaded, three roles are there
after 1.04 s instead of 0.57 s (medians of 10 starts on a busy machine), since it imports Numba and
zenoh once more.
"""

import atexit
import gc
import importlib
import json
import os
import select
import selectors
import signal
import socket
import subprocess
import sys
import threading
import weakref
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import NoReturn, TextIO

from setproctitle import setproctitle

from hertzloop.common.sanitize import visible
from hertzloop.processes.signals import end_with_parent

# What a role runs. By name, as in `python -m`: the command line imports this module.
_PROGRAM = "hertzloop.__main__"
_DESCRIPTORS = 5  # of a request: its file, standard input, output and error, and the exit code


class Role:
    """A process that the server has forked, with the part of `subprocess.Popen` that a launcher
    needs."""

    def __init__(self, pid: int, stdin: int, stdout: int, status: int) -> None:
        self.pid = pid
        self.stdin: TextIO = os.fdopen(stdin, "w")
        self.stdout: TextIO = os.fdopen(stdout)
        self.returncode: int | None = None
        self._status = status
        self._reading = threading.Lock()

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal; None while the process runs."""
        if self._reading.acquire(blocking=False):  # else a thread waits, and will set the code
            try:
                if self.returncode is None and select.select([self._status], [], [], 0.0)[0]:
                    self._read()
            finally:
                self._reading.release()
        return self.returncode

    def wait(self) -> int:
        """Wait for the end of the process and return its exit code.

        The code is 1 if the server was killed: nobody can tell how the role ended.
        """
        with self._reading:
            if self.returncode is None:
                self._read()
        assert self.returncode is not None
        return self.returncode

    def _read(self) -> None:
        self.returncode = int(os.read(self._status, 16) or b"1")
        os.close(self._status)

    def send_signal(self, number: int) -> None:
        """Send a signal to the process unless it has ended."""
        if self.poll() is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self) -> None:
        """Ask the process to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End the process."""
        self.send_signal(signal.SIGKILL)


class ForkServer:
    """A process that forks roles on request, until this object's process ends."""

    def __init__(self) -> None:
        self._requests, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.process: subprocess.Popen[bytes] | None = None
        if _has_one_thread():
            self._fork(theirs)
        else:  # a fork would copy locks that another thread holds
            self.process = subprocess.Popen(
                # -P: a folder of the user's that is called like one of ours must not be imported
                [sys.executable, "-P", "-m", __name__, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
            )
        theirs.close()

    def _fork(self, theirs: socket.socket) -> None:
        _load()
        sys.stdout.flush()
        sys.stderr.flush()
        if os.fork() == 0:
            try:
                self._requests.close()
                os.setsid()
                _serve(theirs)
            finally:
                os._exit(1)

    def start(
        self, arguments: Sequence[str], stderr: Path, more: Mapping[str, str], program: bool
    ) -> Role:
        """Start `hertzloop ARGUMENTS` in this working directory, with this environment.

        Args:
            arguments: the command line after the program's name; of another `program` all of it.
            stderr: file that takes standard error.
            more: variables beside those of this environment.

        Raises:
            OSError: the server has ended, or the system refuses another process.
        """
        request = {
            "arguments": list(arguments),
            "cwd": os.getcwd(),
            "environment": {**os.environ, **more},
            "program": program,
        }
        stdin, stdout, status = os.pipe(), os.pipe(), os.pipe()
        # A file in memory: an environment may be larger than any message.
        with stderr.open("w") as sink, os.fdopen(os.memfd_create("request"), "w") as file:
            json.dump(request, file)
            file.flush()
            theirs = [file.fileno(), stdin[0], stdout[1], sink.fileno(), status[1]]
            try:
                socket.send_fds(self._requests, [b"start"], theirs)
                answer = self._requests.recv(64)
                if not answer:
                    raise BrokenPipeError("the fork server has ended")
                pid = int(answer)
                if pid < 0:
                    raise OSError(-pid, os.strerror(-pid))
            except OSError:
                for end in (stdin[1], stdout[0], status[0]):
                    os.close(end)
                raise
            finally:
                for end in (stdin[0], stdout[1], status[1]):
                    os.close(end)
        return Role(pid, stdin[1], stdout[0], status[0])


def _has_one_thread() -> bool:
    """Whether this process has no thread but this one, be it of Python or not."""
    return len(os.listdir("/proc/self/task")) == 1


_servers: dict[int, ForkServer] = {}  # by process: a fork has the server of its parent, too


def prepare() -> ForkServer:
    """Return the fork server of this process, started by the first call."""
    if os.getpid() not in _servers:
        _servers.clear()  # its socket is closed with it, which ends it
        _servers[os.getpid()] = ForkServer()
    return _servers[os.getpid()]


def start(
    arguments: Sequence[str],
    stderr: Path,
    more: Mapping[str, str] = MappingProxyType({}),
    program: bool = False,
) -> Role:
    """Start a role; see `ForkServer.start`. A server that was killed is replaced once."""
    try:
        return prepare().start(arguments, stderr, more, program)
    except (BrokenPipeError, ConnectionResetError):
        _servers.clear()
        return prepare().start(arguments, stderr, more, program)


@cache
def _load() -> None:
    importlib.import_module(_PROGRAM).load()


def _serve(requests: socket.socket) -> NoReturn:
    """Fork a role for every request, and report how it ended; until the launcher has gone."""
    for number in (signal.SIGINT, signal.SIGTERM):  # of the launcher, from which it was forked
        signal.signal(number, signal.SIG_DFL)
    setproctitle("hertzloop fork server")
    gc.freeze()  # the pages of what is loaded stay shared
    waiting = selectors.DefaultSelector()
    waiting.register(requests, selectors.EVENT_READ)
    while True:
        for ready, _ in waiting.select():
            if ready.fileobj is not requests:
                pid, status = ready.data
                waiting.unregister(ready.fileobj)
                os.close(ready.fd)
                code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
                with suppress(OSError):
                    os.write(status, str(code).encode())
                os.close(status)
                continue
            message, given, _, _ = socket.recv_fds(requests, 16, _DESCRIPTORS)
            if not message:
                os._exit(0)
            *given, status = given
            try:
                pid = os.fork()
            except OSError as error:
                requests.send(str(-(error.errno or 1)).encode())
                os.close(status)
            else:
                if pid == 0:
                    requests.close()
                    waiting.close()
                    os.close(status)
                    _become(*given)
                requests.send(str(pid).encode())
                waiting.register(os.pidfd_open(pid), selectors.EVENT_READ, (pid, status))
            for descriptor in given:
                os.close(descriptor)


def _become(file: int, *streams: int) -> NoReturn:
    """Run a command in this fork as a fresh process would, and end it."""
    code = 1
    # What the launcher asked for at its exit is not this process's to do.
    atexit._clear()
    weakref.finalize._registry.clear()  # type: ignore[attr-defined]
    weakref.finalize._registered_with_atexit = False  # type: ignore[attr-defined]
    try:
        os.setsid()
        for number, stream in enumerate(streams):
            os.dup2(stream, number)
            os.close(stream)
        os.lseek(file, 0, os.SEEK_SET)
        with os.fdopen(file) as text:
            request = json.load(text)
        os.environ.clear()
        os.environ.update(request["environment"])
        os.chdir(request["cwd"])
        if request["program"]:
            # It does not watch its standard input: it ends with this server, so with the launcher.
            end_with_parent()
            os.execvp(request["arguments"][0], request["arguments"])
        # The caller may have replaced them, as pytest and notebooks do.
        sys.stdin, sys.stdout = open(0), open(1, "w")  # noqa: SIM115
        sys.stderr = open(2, "w", buffering=1)  # noqa: SIM115
        sys.argv = ["hertzloop", *request["arguments"]]
        setproctitle(visible(" ".join(sys.argv)))
        importlib.import_module(_PROGRAM).main()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException as error:
        sys.excepthook(type(error), error, error.__traceback__)
    finally:
        atexit._run_exitfuncs()
        with suppress(OSError, ValueError):
            sys.stdout.flush()
        with suppress(OSError, ValueError):
            sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    _load()
    _serve(socket.socket(fileno=int(sys.argv[1])))
