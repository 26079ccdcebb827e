"""The commands `hertzloop node plant`, `controller` and `recorder`: one process of a run each."""

import json
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from hertzloop.bus.port import BusError, EndedByOther, PeerLost
from hertzloop.bus.process_clock import clock
from hertzloop.bus.sockets import too_long
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES, StreamFault
from hertzloop.bus.zenoh_config import endpoints_named, names_endpoints
from hertzloop.cli import options
from hertzloop.cli.recordings import repeat_or_fail
from hertzloop.cli.terminal import err, fail, out
from hertzloop.loop.run_options import BusOptions, RunOptions
from hertzloop.processes import roles
from hertzloop.processes.program import BASE_PORT, BUS_NAME
from hertzloop.processes.roles import BusAddress, default_endpoints
from hertzloop.processes.signals import INTERRUPTED
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.scene.loading import DEFAULT

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
    which roles were missing (`lost`), and when that was found (`at_s`). While the process runs, it
    says so again and again (`beat`).
    """

    def tell(**what: object) -> None:
        if machine:
            with suppress(BrokenPipeError):  # the launcher is gone, and cannot be told
                print(json.dumps(what) + "\n", end="", flush=True)  # at once: threads do

    if machine:
        roles.end_with_the_launcher()
        clock.on_beat = lambda: tell(beat=True)
    try:
        yield tell
    except KeyboardInterrupt as error:
        sentence = str(error) or f"{role} was interrupted"
        tell(fault=sentence)
        if not machine:
            err.print(sentence)
        raise typer.Exit(INTERRUPTED) from None
    except (BusError, StreamFault, RecordingError) as error:
        missed: dict[str, object] = {}
        if isinstance(error, PeerLost):
            missed = {"lost": list(error.roles), "at_s": error.at_s}
        others = isinstance(error, PeerLost | EndedByOther)
        tell(fault=str(error), others=others, **missed)
        if not machine:
            fail(str(error), 1)
        raise typer.Exit(1) from None
    finally:
        clock.on_beat = lambda: None


def bus_address(role: str, request: RunOptions, bus: BusOptions) -> BusAddress:
    """Address from the options of a command, else from its configuration, else on loopback.

    Ends the command if an endpoint or the configuration is none.
    """
    check_endpoints("--listen", bus.listen)
    check_endpoints("--connect", bus.connect)
    config = bus.zenoh_config
    own, others = default_endpoints(role, [BASE_PORT, BASE_PORT + 1, BASE_PORT + 2])
    try:
        if config:
            own = [] if names_endpoints(config, "listen") else own
            others = [] if names_endpoints(config, "connect") else others
            for endpoint in endpoints_named(config):
                _check_port(f"--zenoh-config: {config}: '{endpoint}'", endpoint)
    except BusError as error:
        fail(f"--zenoh-config: {error}")
    return BusAddress(
        request.name or BUS_NAME, bus.listen or own, bus.connect or others, config,
        request.timeout_s, bus.wait_s, bus.machine,
    )  # fmt: skip


@contextmanager
def playing(
    role: str, request: RunOptions, bus: BusOptions
) -> Iterator[tuple[Callable[..., None], BusAddress]]:
    """Frame of a role that meets the others: see `framed`; and where it does."""
    with framed(role, bus.machine) as tell:
        address = bus_address(role, request, bus)
        if not bus.machine:
            others = " and ".join(other for other in ROLES if other != role)
            err.print(f"{role} on {where(address)}: waiting for {others}")
        yield tell, address


def check_endpoints(option: str, endpoints: Sequence[str]) -> None:
    """End the command if what an option gives is no endpoint."""
    for endpoint in endpoints:
        found = _ENDPOINT.fullmatch(endpoint)
        if not found:
            example = f"tcp/127.0.0.1:{BASE_PORT}"
            fail(f"{option} = '{endpoint}': invalid endpoint. Write it as {example}.")
        _check_port(f"{option} '{endpoint}'", endpoint)
        if too_long(endpoint):
            fail(f"{option} = '{endpoint}': the path is too long. Use at most 107 bytes.")


def _check_port(named: str, endpoint: str) -> None:
    """End the command if an endpoint's port, if it has one, cannot be."""
    found = _PORT.search(endpoint)
    if found and int(found["port"]) > options.LARGEST_PORT:
        fail(f"{named} has no port up to {options.LARGEST_PORT}")


def where(address: BusAddress) -> str:
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


def say_profile(stats: dict[str, Any]) -> None:
    """One line on what was granted."""
    err.say(f"real-time profile: {stats['realtime']}")


@options.takes(PLANT, name=BUS_NAME, realtime="auto")
def plant(
    request: RunOptions,
    bus: BusOptions,
    scene: options.SceneArgument = DEFAULT,
    settings: options.SetOption = None,
    seed: options.SeedOption = None,
) -> None:
    """Run the plant as a separate process.

    It waits for controller and recorder, then runs the scene.
    """
    resolved = options.scene_from(scene, settings, seed, tried=bus.machine)
    options.check_pace(resolved, request)
    repeat = request.repeat
    repeated = repeat_or_fail(read(repeat), resolved) if repeat else None
    with playing(PLANT, request, bus) as (tell, address):
        stats = roles.run_plant(
            resolved, replace(address, on_open=lambda: tell(open=True)), request,
            lambda: tell(ready=True), progress_reporter(tell), repeated,
        )  # fmt: skip
        tell(done=stats)
        if not bus.machine:
            say_profile(stats)
            out.print(f"{resolved.steps:,} steps in {stats['wall_s']:z.3f} s")


@options.takes(CONTROLLER, name=BUS_NAME, realtime="auto")
def controller(
    request: RunOptions,
    bus: BusOptions,
    law: str | None = None,
) -> None:
    """Run the controller as a separate process.

    It takes the scene from the plant, then answers the plant's samples.

    Args:
        law: Load the law from this file; default: controller.law of the scene.
    """
    with playing(CONTROLLER, request, bus) as (tell, address):
        stats = roles.run_controller(address, request, lambda: tell(ready=True), law)
        tell(done=stats)
        if not bus.machine:
            say_profile(stats)


@options.takes(RECORDER, name=BUS_NAME, realtime="auto")
def recorder(
    request: RunOptions,
    bus: BusOptions,
    out_file: Annotated[Path, typer.Option("--out", "-o")] = Path("run.mcap"),
) -> None:
    """Run the recorder as a separate process.

    It writes every stream of a run into one MCAP file.

    Args:
        out_file: Recording to write.
    """
    options.check_recording(out_file, request.overwrite)
    with playing(RECORDER, request, bus) as (tell, address):
        stats = roles.run_recorder(out_file, address, request, lambda: tell(ready=True))
        tell(done=stats)
        if not bus.machine:
            out.print(f"recorded {out_file}")
