"""A controller that is a program of the user's: its command line, and where it meets the run."""

import os
import shlex
import shutil
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from hertzloop.bus.port import BusError
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


def run_program(_: object, command: str, words: Sequence[str], stderr: Path) -> dict[str, Any]:
    """Run a program of the user's, in the process of its role, until it ends.

    It ends with this process. Its standard output is for people, and is dropped.

    Args:
        command: Its command line.
        words: The same, filled in.
        stderr: File that has its standard error.

    Raises:
        BusError: It fails.
    """
    with subprocess.Popen(
        words,
        stdin=subprocess.PIPE,  # never written to
        stdout=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=end_with_parent,
    ) as process:
        try:
            code = process.wait()
        finally:  # with what a shell has started for it
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    if code:
        raise BusError(f"{CONTROLLER} ('{command}') {how_it_failed(code, stderr)}")
    return {"left": True}


def how_it_failed(code: int, stderr: Path) -> str:
    """Return how a process has failed, by its exit code and its last line of standard error."""
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    lines = stderr.read_text(errors="replace").strip().splitlines() or ["no message"]
    return f"failed with exit code {code}: {lines[-1]}"
