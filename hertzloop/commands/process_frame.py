"""What the commands of single processes share: faults in words, addresses, progress."""

import json
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer

from hertzloop.commands.options import LARGEST_PORT
from hertzloop.commands.terminal import err, fail
from hertzloop.processes.signals import (
    INTERRUPTED,
    end_with_the_launcher,
    on_interrupt,
    raise_when_ended,
)

if TYPE_CHECKING:
    from hertzloop.processes.roles import BusAddress

# Of the kinds that zenoh comes with here.
_ENDPOINT = re.compile(
    r"unixsock-stream/\S+|(?:tcp|tls|quic|udp|ws)/[^\s?#]+:[0-9]{1,9}(?:[?#]\S+)?"
)
_PORT = re.compile(r"(?:tcp|tls|quic|udp|ws)/[^\s?#]+:(?P<port>[0-9]+)(?:[?#]|$)")


@contextmanager
def framed(role: str, machine: bool) -> Iterator[Callable[..., None]]:
    """Frame of a process of a run: yields a function that reports to a launcher (`machine`).

    Faults are reported too, or told to a person; then the command ends with exit code 1, or
    130 if it was interrupted. A report says whether the fault is another role's (`others`),
    which roles were missing (`lost`), and when that was found (`at_s`).
    """
    from bus.port import BusError, EndedByOther, PeerLost
    from bus.streams import StreamFault
    from recordings.writer import RecordingError

    def tell(**what: object) -> None:
        if machine:
            with suppress(BrokenPipeError):  # the launcher is gone, and cannot be told
                print(json.dumps(what), flush=True)

    def interrupted(sentence: str) -> NoReturn:
        sentence = sentence or f"{role} was interrupted"
        tell(fault=sentence)
        if not machine:
            err.print(sentence, markup=False)
        raise typer.Exit(INTERRUPTED)

    raise_when_ended()
    if machine:
        end_with_the_launcher()
    try:
        with on_interrupt(interrupted):
            yield tell
    except (BusError, StreamFault, RecordingError) as error:
        missed: dict[str, object] = {}
        if isinstance(error, PeerLost):
            missed = {"lost": list(error.roles), "at_s": error.at_s}
        others = isinstance(error, PeerLost | EndedByOther)
        tell(fault=str(error), others=others, **missed)
        if not machine:
            fail(str(error), 1)
        raise typer.Exit(1) from None


def bus_address(
    role: str,
    name: str,
    listen: list[str] | None,
    connect: list[str] | None,
    config: Path | None,
    timeout: float,
    wait: float,
) -> "BusAddress":
    """Address from the options of a command, else from `config`, else on loopback.

    Ends the command if an endpoint or `config` is none.
    """
    from bus.port import BusError
    from bus.zenoh_config import endpoints_named, names_endpoints
    from hertzloop.processes.roles import BASE_PORT, BusAddress, default_endpoints

    check_endpoints("--listen", listen)
    check_endpoints("--connect", connect)
    own, others = default_endpoints(role, [BASE_PORT, BASE_PORT + 1, BASE_PORT + 2])
    try:
        if config:
            own = [] if names_endpoints(config, "listen") else own
            others = [] if names_endpoints(config, "connect") else others
            for endpoint in endpoints_named(config):
                _check_port(f"--zenoh-config: {config}: '{endpoint}'", endpoint)
    except BusError as error:
        fail(f"--zenoh-config: {error}", 2)
    return BusAddress(name, listen or own, connect or others, config, timeout, wait)


def check_endpoints(option: str, endpoints: list[str] | None) -> None:
    """End the command if what an option gives is no endpoint."""
    from bus.sockets import too_long
    from hertzloop.processes.roles import BASE_PORT

    for endpoint in endpoints or []:
        found = _ENDPOINT.fullmatch(endpoint)
        if not found:
            example = f"tcp/127.0.0.1:{BASE_PORT}"
            fail(f"{option} '{endpoint}' is no endpoint; write e.g. {example}", 2)
        _check_port(f"{option} '{endpoint}'", endpoint)
        if too_long(endpoint):
            fail(f"the path of '{endpoint}' is too long for a socket; Linux takes 107 bytes", 2)


def _check_port(named: str, endpoint: str) -> None:
    """End the command if an endpoint's port, if it has one, cannot be."""
    found = _PORT.search(endpoint)
    if found and int(found["port"]) > LARGEST_PORT:
        fail(f"{named} has no port up to {LARGEST_PORT}", 2)


def where(address: "BusAddress") -> str:
    """Where a role listens, in words."""
    return ", ".join(address.listen) or f"the endpoints of {address.config_file}"


def progress_reporter(tell: Callable[..., None]) -> Callable[[int], None]:
    """Report progress at most ten times a second."""

    last = [0.0]

    def report(step: int) -> None:
        now = time.monotonic()
        if now - last[0] > 0.1:
            last[0] = now
            tell(step=step)

    return report
