"""A controller that is a program of the user's: its command line, and where it meets the run."""

import os
import shlex
import shutil
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from hertzloop.bus.sockets import mesh_endpoints, on_loopback, reserved_ports
from hertzloop.bus.streams import CONTROLLER
from hertzloop.loop.run_options import OptionError
from hertzloop.processes.signals import end_with_parent

BASE_PORT = 7450  # plant's; controller and recorder have the next two
LARGEST_PORT = 65535
BUS_NAME = "hertzloop"  # of a run whose processes are not told another
_PLACES = ("{listen}", "{connect}")


def filled_in(command: str, name: str, endpoints: Sequence[str]) -> list[str]:
    """The words of a command line, with {name}, {listen} and {connect} of the controller."""
    [listen], [connect] = mesh_endpoints(CONTROLLER, endpoints)
    words = shlex.split(command)
    for place, value in (("{name}", name), *zip(_PLACES, (listen, connect), strict=True)):
        words = [word.replace(place, value) for word in words]
    return words


def name_on_bus(command: str, name: str | None) -> str | None:
    """Return the name of a run on the bus; None for a new one, which the command line passes on."""
    return name or (None if "{name}" in command else BUS_NAME)


def check_command(command: str) -> None:
    """Raise OptionError for a command line that cannot be started."""
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise OptionError(f"--controller = '{command}': {error}. Close the quotation.") from None
    if not words or shutil.which(words[0]) is None:
        raise OptionError(
            f"--controller = '{command}': cannot be started: no such program. Give its path."
        )
    if sum(place in command for place in _PLACES) == 1:
        raise OptionError(
            f"--controller = '{command}': has one of {{listen}} and {{connect}}. Use both, or "
            f"none for a program that uses the ports from {BASE_PORT} on."
        )


@contextmanager
def meeting_endpoints(command: str, first_port: int | None) -> Iterator[list[str]]:
    """Endpoints of plant, controller and recorder on loopback, until the context ends.

    They are the ports from `first_port` on; without it free ports for a program that is told its
    endpoints, else those that a program uses by default.
    """
    if first_port is None and _PLACES[0] in command:
        with reserved_ports(3) as ports:
            yield on_loopback(ports)
        return
    first = first_port or BASE_PORT
    yield on_loopback(range(first, first + 3))


class Program:
    """A program of the user's that runs, with what a launcher needs of a `multiprocessing` process.

    It ends with the launcher. Its standard output is for people, and is dropped.
    """

    def __init__(self, command: str, words: Sequence[str], stderr: Path) -> None:
        """Start a `command`, filled in as `words`. Raises OSError.

        `stderr` is the file that takes its standard error.
        """
        self._command = command
        with stderr.open("w") as errors:
            self._process = subprocess.Popen(
                words,
                stdin=subprocess.PIPE,  # never written to
                stdout=subprocess.DEVNULL,
                stderr=errors,
                start_new_session=True,
                preexec_fn=end_with_parent,
            )

    def __str__(self) -> str:
        return self._command

    @property
    def pid(self) -> int:
        """Its number in the system."""
        return self._process.pid

    @property
    def exitcode(self) -> int | None:
        """Its exit code, negative for a signal; None while it runs."""
        return self._process.poll()

    def terminate(self) -> None:
        """Ask it to end."""
        self._process.terminate()

    def kill(self) -> None:
        """End it, with what a shell has started for it."""
        assert self._process.stdin
        self._process.stdin.close()
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
