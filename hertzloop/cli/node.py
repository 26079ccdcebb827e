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
from hertzloop.bus.sockets import too_long
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES, StreamFault
from hertzloop.bus.zenoh_config import endpoints_named, names_endpoints
from hertzloop.cli import outputs, prepare
from hertzloop.cli.options import (
    SceneArgument,
    SeedOption,
    SetOption,
    bus_address,
    run_options_of,
)
from hertzloop.cli.recordings import repeat_or_fail
from hertzloop.cli.terminal import err, fail, out
from hertzloop.common.readable import quantity
from hertzloop.loop.run_options import RunOptions
from hertzloop.processes import roles
from hertzloop.processes.program import BASE_PORT, LARGEST_PORT
from hertzloop.processes.roles import BusAddress, default_endpoints
from hertzloop.processes.signals import INTERRUPTED
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.setup import parse
from hertzloop.warmup import CASES, Work, anything_compiled

# Endpoints of the protocols that zenoh has here.
_ENDPOINT = re.compile(
    r"unixsock-stream/\S+|(?:tcp|tls|quic|udp|ws)/[^\s?#]+:[0-9]{1,9}(?:[?#]\S+)?"
)
_PORT = re.compile(r"(?:tcp|tls|quic|udp|ws)/[^\s?#]+:(?P<port>[0-9]+)(?:[?#]|$)")


Report = Callable[..., None]  # takes the parts of a report by name


@run_options_of(PLANT)
@bus_address
def plant(
    options: RunOptions,
    asked: BusAddress,
    scene: SceneArgument = DEFAULT,
    settings: SetOption = None,
    seed: SeedOption = None,
) -> None:
    """Run the plant as a separate process.

    It waits for controller and recorder, then runs the scene.
    """
    setup = prepare.scene_from(scene, settings, seed, law_was_tried=asked.watched)
    prepare.check_pace(setup, options)
    repeated = repeat_or_fail(read(options.repeat), setup) if options.repeat else None
    if not asked.watched:
        paced = [Work.PACED] if options.pace else []
        prepare.compile_first(setup, works=[Work.EXCHANGE, *paced])
    with _on_bus(PLANT, asked) as (report, address):
        stats = roles.run_plant(
            setup,
            replace(address, on_open=lambda: report(open=True)),
            options,
            lambda: _begin(
                report, PLANT, asked, f"{setup.scene.name}, {_duration(setup.run.duration_s)}"
            ),
            _progress_reporter(report),
            repeated,
        )
        report(done=stats)
        if not asked.watched:
            _print_profile(stats)
            out.say(
                f"Complete: {setup.run.steps:,} steps in {stats['wall_s']:z.3f} s. The "
                "recorder has the recording."
            )


@run_options_of(CONTROLLER)
@bus_address
def controller(
    options: RunOptions,
    asked: BusAddress,
    law: Annotated[
        str | None,
        typer.Option(help="Load the law from this file; default: controller.law of the scene."),
    ] = None,
) -> None:
    """Run the controller as a separate process.

    It takes the scene from the plant, then answers the plant's samples.
    """
    if not anything_compiled():
        prepare.announce_compilation("the controller: about 10 s")
    with _on_bus(CONTROLLER, asked) as (report, address):
        begin = lambda: _begin(report, CONTROLLER, asked)  # noqa: E731
        stats = roles.run_controller(address, options, begin, law)
        report(done=stats)
        if not asked.watched:
            _print_profile(stats)
            out.say("Complete: the plant has ended the run. The recorder has the recording.")


@run_options_of(RECORDER)
@bus_address
def recorder(
    options: RunOptions,
    asked: BusAddress,
    out_file: Annotated[Path, typer.Option("--out", "-o", help="Recording to write.")] = Path(
        "run.mcap"
    ),
) -> None:
    """Run the recorder as a separate process.

    It writes every stream of a run into one MCAP file.
    """
    outputs.check_recording(out_file, options.overwrite)
    with _on_bus(RECORDER, asked) as (report, address):
        begin = lambda: _begin(report, RECORDER, asked)  # noqa: E731
        stats = roles.run_recorder(out_file, address, options, begin)
        report(done=stats)
    if not asked.watched:
        _print_recorded(out_file)


def _begin(report: Report, role: str, asked: BusAddress, what: str = "") -> None:
    """Report that the roles have met; tell a person that the run begins."""
    report(ready=True)
    if not asked.watched:
        err.say(f"{role}: running{' ' * bool(what)}{what}")


def _duration(duration_s: float) -> str:
    return f"{quantity(duration_s, 's')} of simulated time"


def _print_recorded(path: Path) -> None:
    """Print what a recording has, its verdict, and the next command."""
    from hertzloop.results.metrics import free_metrics
    from hertzloop.results.verdict import assess_recording
    from hertzloop.views.run import next_lines
    from hertzloop.views.verdict import verdict_sentences

    recording = read(path)
    truth = recording.truth
    out.say(f"Complete: {_duration(truth.samples * truth.step_ns * 1e-9)} in {path}.")
    try:
        setup = parse(recording.scene_toml, recorded=True)
        prepare.compile_first(setup, works=CASES)
        verdict = verdict_sentences(
            assess_recording(setup, recording, free_metrics(setup)).assessment
        )
    except SceneError as error:
        verdict = [f"No verdict, as the run cannot be assessed on this computer: {error}"]
    for sentence in verdict:
        out.say(sentence)
    for line in next_lines(str(path)):
        out.say(line)


@contextmanager
def _on_bus(role: str, asked: BusAddress) -> Iterator[tuple[Report, BusAddress]]:
    """Yield the function that reports to a launcher, and the address where the roles meet.

    The errors of what is inside end the command: see `_reporting`.
    """
    with _reporting(role, asked.watched) as report:
        address = _bus_address(role, asked)
        if not asked.watched:
            others = " and ".join(other for other in ROLES if other != role)
            where = ", ".join(address.listen) or f"the endpoints of {address.zenoh_config}"
            err.print(f"{role} on {where}: waiting for {others}")
        yield report, address


@contextmanager
def _reporting(role: str, machine: bool) -> Iterator[Report]:
    """Yield a function that reports to a launcher, and end the command if the role fails.

    A report is one line of JSON on standard output; without a launcher there is none. A failure
    is reported, or printed for a person; the exit code is then 1, or 130 after an interruption.
    The report of a failure has these parts:

    - `fault`: one sentence.
    - `others`: whether another role caused it.
    - `lost`, `at_s`: the roles that were missing, and when that was noticed.

    Args:
        role: Role of this process.
        machine: Whether a launcher reads the reports.
    """

    def report(**parts: object) -> None:
        if machine:
            with suppress(BrokenPipeError):  # the launcher is gone
                # In one call with the line's end, since several threads report.
                print(json.dumps(parts) + "\n", end="", flush=True)

    if machine:
        roles.end_with_the_launcher()
    try:
        yield report
    except KeyboardInterrupt as error:
        sentence = str(error) or f"{role} was interrupted"
        report(fault=sentence)
        if not machine:
            err.print(sentence)
        raise typer.Exit(INTERRUPTED) from None
    except (BusError, StreamFault, RecordingError) as error:
        missing: dict[str, object] = {}
        if isinstance(error, PeerLost):
            missing = {"lost": list(error.roles), "at_s": error.at_s}
        others = isinstance(error, PeerLost | EndedByOther)
        report(fault=str(error), others=others, **missing)
        if not machine:
            fail(str(error), 1)
        raise typer.Exit(1) from None


def _bus_address(role: str, asked: BusAddress) -> BusAddress:
    """Return where a role meets the others; end the command for an invalid endpoint.

    Endpoints come from the options, else from the zenoh configuration, else they are the usual
    ports on loopback.
    """
    check_endpoints("--listen", asked.listen)
    check_endpoints("--connect", asked.connect)
    config = asked.zenoh_config
    listen, connect = default_endpoints(role, [BASE_PORT, BASE_PORT + 1, BASE_PORT + 2])
    try:
        if config:
            listen = [] if names_endpoints(config, "listen") else listen
            connect = [] if names_endpoints(config, "connect") else connect
            for endpoint in endpoints_named(config):
                _check_port(f"--zenoh-config: {config}: '{endpoint}'", endpoint)
    except BusError as error:
        fail(f"--zenoh-config: {error}")
    return replace(asked, listen=asked.listen or listen, connect=asked.connect or connect)


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


def _progress_reporter(report: Report) -> Callable[[int], None]:
    """Return a function that reports the step, at most ten times a second."""
    last_s = 0.0

    def report_step(step: int) -> None:
        nonlocal last_s
        now_s = time.monotonic()
        if now_s - last_s > 0.1:
            last_s = now_s
            report(step=step)

    return report_step


def _print_profile(stats: dict[str, Any]) -> None:
    """Print which real-time scheduling the system has granted."""
    err.say(f"real-time profile: {stats['realtime']}")
