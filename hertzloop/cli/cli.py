"""The command line. Exit codes: 0 done, 1 a run failed or recordings differ, 2 the user's
mistake, 130 interrupted."""

import os
import secrets
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from functools import cache
from pathlib import Path
from typing import Annotated, cast

import typer

from hertzloop.bus import LEAVING
from hertzloop.cli import export as export_command
from hertzloop.cli import export as export_plant_command
from hertzloop.cli import latency as bench_command
from hertzloop.cli import latency as validity_command
from hertzloop.cli import laws as conformance_command
from hertzloop.cli import laws as law_commands
from hertzloop.cli import listen as listen_command
from hertzloop.cli import listing as listing_commands
from hertzloop.cli import listing as modes_command
from hertzloop.cli import margin as margin_command
from hertzloop.cli import recordings as pictures_command
from hertzloop.cli import recordings as recording_commands
from hertzloop.cli import recordings as report_page
from hertzloop.cli import roles as role_commands
from hertzloop.cli import roles as watch_command
from hertzloop.cli import studies as published_commands
from hertzloop.cli import studies as study_commands
from hertzloop.cli import sweeps as sweep_commands
from hertzloop.cli import tune as tune_command
from hertzloop.cli.options import (
    Commands,
    FastLaneOption,
    HorizonOption,
    JsonOption,
    OverwriteOption,
    PaceOption,
    RealtimeOption,
    SceneArgument,
    SeedOption,
    SetOption,
    TimeoutOption,
    TransportName,
    check_json,
    check_pace,
    check_recording,
    compile_first,
    fail,
    files_of,
    if_interrupted,
    out,
    progress,
    scene_from,
    write_json,
)
from hertzloop.cli.recordings import read_or_fail, repeat_or_fail, scene_to_run
from hertzloop.processes.signals import raise_when_ended
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import DEFAULT

app = typer.Typer(
    cls=Commands,
    help="Try an active force law against an impact at 1 MHz, over a real message bus.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    add_completion=False,
)


@app.command()
def run(
    scene: SceneArgument = DEFAULT,
    out_file: Annotated[Path | None, typer.Option("--out", help="Recording to write.")] = None,
    transport: Annotated[TransportName, typer.Option(help="How the parts talk.")] = "zenoh",
    seed: SeedOption = None,
    settings: SetOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
    horizon: HorizonOption = None,
    port: Annotated[
        int | None,
        typer.Option(
            min=1, max=65533, help="First of three ports on loopback; private if left out."
        ),
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the run on the bus.")] = None,
    timeout: TimeoutOption = 5.0,
    fast_lane: FastLaneOption = True,
    realtime: RealtimeOption = "auto",
    pace: PaceOption = None,
    repeat: Annotated[
        Path | None,
        typer.Option(
            help="Run the scene of a recording again in lock-step, under the forces that acted "
            "there, late ones as late as they were.",
            metavar="F.mcap",
        ),
    ] = None,
    verify: Annotated[
        bool,
        typer.Option(
            "--verify", help="Repeat with half the step and twice the modes, loop closed."
        ),
    ] = False,
    live: Annotated[
        bool, typer.Option("--live", help="Show it while it goes on, in a viewer beside it.")
    ] = False,
) -> None:
    """Run a scene, record it, and print what happened with and without control."""
    raise_when_ended()
    if repeat is not None and (scene != DEFAULT or settings or seed is not None):
        fail("--repeat takes scene and seed from the recording; leave out SCENE, --set, --seed", 2)
    repeated = read_or_fail(repeat) if repeat else None
    resolved = scene_to_run(repeated) if repeated else scene_from(scene, settings, seed)
    recording = out_file or Path(f"{resolved.name}{'-again' if repeat else ''}.mcap")
    inputs = [repeat] if repeat else files_of(resolved, scene, *(settings or []))
    check_recording(recording, overwrite, read=inputs)
    check_json(json_file, recording)
    if verify:
        from hertzloop.analysis.trust import check_verifiable

        try:
            check_verifiable(resolved)
        except SceneError as error:
            fail(str(error), 2)
    if live and transport != "zenoh":
        fail(f"--live listens on the bus; --transport {transport} has none", 2)
    for option in ("pace",) * bool(pace) + ("repeat",) * bool(repeat):
        if transport != "zenoh":
            fail(f"--{option} needs processes of their own; --transport {transport} has none", 2)
    check_pace(resolved, pace, timeout, horizon=horizon, verify=verify, repeat=repeat)
    if repeated is not None:
        repeat_or_fail(repeated, resolved)  # before three processes are started for nothing
    compile_first(resolved, paced=pace is not None)

    from hertzloop.bus.port import BusError
    from hertzloop.bus.sockets import on_loopback, own_endpoints
    from hertzloop.bus.streams import StreamFault
    from hertzloop.processes import fork_server
    from hertzloop.processes.launcher import RunFailed, RunOptions, Transport, what_is_kept
    from hertzloop.processes.observer import observer_beside
    from hertzloop.recordings.writer import RecordingError
    from hertzloop.views import run as report
    from hertzloop.views.data import run_scene

    endpoints = on_loopback([port, port + 1, port + 2]) if port else None
    held = ExitStack()
    if live:
        endpoints = endpoints or held.enter_context(own_endpoints())
        name = name or f"live-{os.getpid()}-{secrets.token_hex(4)}"
    options = RunOptions(
        transport=Transport(transport),
        overwrite=overwrite,
        horizon=horizon,
        endpoints=endpoints,
        name=name,
        timeout_s=timeout,
        verify=verify,
        fast_lane=fast_lane,
        realtime=realtime,
        pace=pace,
        repeat=repeat,
    )
    started_s = time.time()
    if transport == "zenoh":
        fork_server.prepare()  # before anything starts a thread
    try:
        with (
            if_interrupted(lambda: what_is_kept(recording, started_s)),
            held,
            observer_beside(name, endpoints) if live and name and endpoints else nullcontext(),
            progress(resolved.name, resolved.steps) as advance,
        ):
            data = run_scene(resolved, recording, options, advance)
    except SceneError as error:
        fail(str(error), 2)
    except (RunFailed, BusError, StreamFault, RecordingError) as error:
        fail(str(error), 1)
    report.print_run(out, data)
    write_json(json_file, data)
    if data.get("differs"):
        raise typer.Exit(1)


listing_commands.register(app)
role_commands.register(app)
recording_commands.register(app)
study_commands.register(app)
app.command()(bench_command.bench)
published_commands.register_published(app)
sweep_commands.register(app)
law_commands.register(app)
modes_command.register_modes(app)
validity_command.register(app)
app.command()(export_command.export)
app.command()(export_plant_command.export_plant)
app.command()(pictures_command.pictures)
app.command()(listen_command.listen)
app.command()(report_page.report)
app.command()(watch_command.watch)
app.command()(tune_command.tune)
app.command()(margin_command.margin)
app.command()(conformance_command.conformance)


@cache
def built() -> Callable[[], None]:
    """The commands, made of their functions; this takes a while."""
    return cast(Callable[[], None], typer.main.get_command(app))


def main(commands: Callable[[], None]) -> None:
    """Run what the command line asks for."""
    try:
        commands()
    except SystemExit as end:
        if any(thread.name == LEAVING for thread in threading.enumerate()):
            # zenoh still calls Python from its threads, which aborts when Python ends in order.
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(end.code if isinstance(end.code, int) else 1)
        raise
