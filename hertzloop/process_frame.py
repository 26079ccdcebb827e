"""What the commands of single processes share: faults in words, addresses, progress."""

import json
import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer

from hertzloop.terminal import err, fail

if TYPE_CHECKING:
    from hertzloop.processes import BusAddress


@contextmanager
def framed(role: str, machine: bool) -> Iterator[Callable[..., None]]:
    """Frame of a process of a run: yields a function that reports to a launcher (`machine`).

    Faults are reported too, or told to a person; then the command ends with exit code 1, or
    130 if it was interrupted.
    """
    from bus.port import BusError, PeerLost
    from bus.streams import StreamFault
    from hertzloop.processes import Interrupted
    from recordings.writer import RecordingError

    def tell(**what: object) -> None:
        if machine:
            print(json.dumps(what), flush=True)

    def stop(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, stop)
    try:
        yield tell
    except (BusError, StreamFault, RecordingError) as error:
        tell(fault=str(error), lost_a_peer=isinstance(error, PeerLost))
        if not machine:
            fail(str(error), 1)
        raise typer.Exit(1) from None
    except (Interrupted, KeyboardInterrupt) as error:
        tell(fault=str(error) or f"{role} was interrupted", lost_a_peer=True)
        if not machine:
            err.print(str(error) or f"{role} was interrupted")
        raise typer.Exit(130) from None


def bus_address(
    role: str,
    name: str,
    listen: list[str] | None,
    connect: list[str] | None,
    config: Path | None,
    timeout: float,
    wait: float,
) -> "BusAddress":
    """Address from the options of a command; without a `config`, loopback is the default.

    Ends the command if an endpoint is none.
    """
    from hertzloop.processes import BASE_PORT, BusAddress, default_endpoints

    for endpoint in [*(listen or []), *(connect or [])]:
        if not re.fullmatch(r"[a-z]+/\S+", endpoint):
            fail(f"'{endpoint}' is no endpoint; write e.g. tcp/127.0.0.1:{BASE_PORT}", 2)
    own, others = default_endpoints(role, [BASE_PORT, BASE_PORT + 1, BASE_PORT + 2])
    given = config is not None
    return BusAddress(
        name,
        listen or ([] if given else own),
        connect or ([] if given else others),
        config,
        timeout,
        wait,
    )


def progress_reporter(tell: Callable[..., None]) -> Callable[[int], None]:
    """Report progress at most ten times a second."""

    last = [0.0]

    def report(step: int) -> None:
        now = time.monotonic()
        if now - last[0] > 0.1:
            last[0] = now
            tell(step=step)

    return report
