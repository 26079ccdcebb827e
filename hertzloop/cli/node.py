"""The commands `hertzloop node plant`, `controller` and `recorder`: one process of a run each."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from hertzloop.bus.port import BusError
from hertzloop.bus.sockets import mesh_endpoints, on_loopback, too_long
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES
from hertzloop.bus.zenoh_config import endpoints_named, names_endpoints
from hertzloop.cli import outputs, prepare
from hertzloop.cli.options import (
    SceneArgument,
    SeedOption,
    SetOption,
    options_of,
    run_options_of,
)
from hertzloop.cli.recordings import repeat_or_fail
from hertzloop.cli.terminal import err, fail, out
from hertzloop.common.readable import quantity
from hertzloop.loop.run_options import RunOptions
from hertzloop.processes import roles
from hertzloop.processes.child_process import Report
from hertzloop.processes.program import BASE_PORT, LARGEST_PORT
from hertzloop.processes.record import told_where
from hertzloop.processes.roles import BusAddress
from hertzloop.processes.signals import INTERRUPTED
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT
from hertzloop.warmup import anything_compiled

# Endpoints of the protocols that zenoh has here.
_ENDPOINT = re.compile(
    r"unixsock-stream/\S+|(?:tcp|tls|quic|udp|ws)/[^\s?#]+:[0-9]{1,9}(?:[?#]\S+)?"
)
_PORT = re.compile(r"(?:tcp|tls|quic|udp|ws)/[^\s?#]+:(?P<port>[0-9]+)(?:[?#]|$)")


@run_options_of(PLANT)
@options_of(BusAddress, argument="asked")
def plant(
    scene: SceneArgument = DEFAULT,
    settings: SetOption = None,
    seed: SeedOption = None,
    *,
    asked: BusAddress,
    options: RunOptions,
) -> None:
    """Run the plant as a separate process.

    It waits for controller and recorder, then runs the scene.
    """
    setup = prepare.scene_from(scene, settings, seed)
    prepare.check_pace(setup, options)
    if options.repeat:
        repeat_or_fail(read(options.repeat), setup)
    prepare.compile_first(setup)
    what = f" {setup.scene.name}, {_duration(setup.run.duration_s)}"
    with _on_bus(PLANT, asked) as address:
        stats = roles.run_plant(setup, address, options, _says_when_ready(PLANT, what))
    _print_profile(stats)
    out.say(
        f"Complete: {setup.run.steps:,} steps in {stats['wall_s']:z.3f} s. The recorder has the "
        "recording."
    )


@run_options_of(CONTROLLER)
@options_of(BusAddress, argument="asked")
def controller(
    law: Annotated[
        str | None,
        typer.Option(help="Load the law from this file; default: controller.law of the scene."),
    ] = None,
    *,
    asked: BusAddress,
    options: RunOptions,
) -> None:
    """Run the controller as a separate process.

    It takes the scene from the plant, then answers the plant's samples.
    """
    if not anything_compiled():
        prepare.announce_compilation("the controller: about 10 s")
    with _on_bus(CONTROLLER, asked) as address:
        stats = roles.run_controller(address, options, _says_when_ready(CONTROLLER), law)
    _print_profile(stats)
    out.say("Complete: the plant has ended the run. The recorder has the recording.")


@run_options_of(RECORDER)
@options_of(BusAddress, argument="asked")
def recorder(
    out_file: Annotated[Path, typer.Option("--out", "-o", help="Recording to write.")] = Path(
        "run.mcap"
    ),
    *,
    asked: BusAddress,
    options: RunOptions,
) -> None:
    """Run the recorder as a separate process.

    It writes every stream of a run into one MCAP file.
    """
    outputs.check_recording(out_file, options.overwrite)
    with told_where(out_file), _on_bus(RECORDER, asked) as address:
        roles.run_recorder(out_file, address, options, _says_when_ready(RECORDER))
    _print_recorded(out_file)


def _says_when_ready(role: str, what: str = "") -> Report:
    """Return a report that says that the roles have met, and that the run begins."""

    def report(**parts: object) -> None:
        if "ready" in parts:
            err.say(f"{role}: running{what}")

    return report


def _duration(duration_s: float) -> str:
    return f"{quantity(duration_s, 's')} of simulated time"


def _print_recorded(path: Path) -> None:
    """Print what a recording has, its verdict, and the next command."""
    from hertzloop.results.inspection import inspected
    from hertzloop.results.recorded import setup_of
    from hertzloop.views.report import next_lines
    from hertzloop.views.verdict import verdict_sentences

    recording = read(path)
    truth = recording.truth
    out.say(f"Complete: {_duration(truth.samples * truth.step_ns * 1e-9)} in {path}.")
    try:
        setup = setup_of(recording)
        prepare.compile_first(setup)
        found = inspected(recording, against_none=True, setup=setup)
        verdict = verdict_sentences(found.assessment) if found.assessment else found.problems
    except (RecordingError, SceneError) as error:
        verdict = [f"No verdict: {error}"]
    for sentence in verdict:
        out.say(sentence)
    for line in next_lines(str(path)):
        out.say(line)


@contextmanager
def _on_bus(role: str, asked: BusAddress) -> Iterator[BusAddress]:
    """Yield the address where the roles meet; say that this one waits there for the others.

    An interruption ends the command with exit code 130 and a sentence.
    """
    address = _bus_address(role, asked)
    others = " and ".join(other for other in ROLES if other != role)
    where = ", ".join(address.listen) or f"the endpoints of {address.zenoh_config}"
    err.print(f"{role} on {where}: waiting for {others}")
    try:
        yield address
    except KeyboardInterrupt as error:
        err.print(str(error) or f"{role} was interrupted")
        raise typer.Exit(INTERRUPTED) from None


def _bus_address(role: str, asked: BusAddress) -> BusAddress:
    """Return where a role meets the others; end the command for an invalid endpoint.

    Endpoints come from the options, else from the zenoh configuration, else they are the usual
    ports on loopback.
    """
    check_endpoints("--listen", asked.listen)
    check_endpoints("--connect", asked.connect)
    config = asked.zenoh_config
    listen, connect = mesh_endpoints(role, on_loopback(range(BASE_PORT, BASE_PORT + 3)))
    try:
        if config:
            listen = [] if names_endpoints(config, "listen") else listen
            connect = [] if names_endpoints(config, "connect") else connect
            for endpoint in endpoints_named(config):
                _check_port(f"--zenoh-config: {config}: '{endpoint}'", endpoint)
    except BusError as error:
        fail(f"--zenoh-config: {error}")
    return asked.replaced(listen=asked.listen or listen, connect=asked.connect or connect)


def check_endpoints(option: str, endpoints: Sequence[str]) -> None:
    """End the command if one of the endpoints that an option gives is invalid."""
    for endpoint in endpoints:
        if not _ENDPOINT.fullmatch(endpoint):
            example = f"tcp/127.0.0.1:{BASE_PORT}"
            fail(f"{option} = '{endpoint}': invalid endpoint. Write it as {example}.")
        _check_port(f"{option} '{endpoint}'", endpoint)
        if too_long(endpoint):
            fail(f"{option} = '{endpoint}': the path is too long. Use at most 107 bytes.")


def _check_port(named: str, endpoint: str) -> None:
    """End the command if an endpoint has a port that is too large."""
    match = _PORT.search(endpoint)
    if match and int(match["port"]) > LARGEST_PORT:
        fail(f"{named} has no port up to {LARGEST_PORT}")


def _print_profile(stats: dict[str, Any]) -> None:
    """Print which real-time scheduling the system has granted."""
    err.say(f"real-time profile: {stats['realtime']}")
