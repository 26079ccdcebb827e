"""The command `run`."""

import os
import secrets
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from hertzloop.bus.sockets import on_loopback, own_endpoints
from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.recordings import repeat_or_fail, scene_to_run
from hertzloop.cli.terminal import fail, if_interrupted, out, progress
from hertzloop.cli.unused_options import check_unused
from hertzloop.loop.run_options import RunOptions, Transport, check_transport
from hertzloop.processes import fork_server
from hertzloop.processes.program import check_command, meeting_endpoints, name_on_bus
from hertzloop.processes.record import what_is_kept
from hertzloop.recordings.reader import read
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.results.run_report import RunReport
from hertzloop.results.verification import check_verifiable
from hertzloop.scene.controller import check_buildable, loaded_law
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.setup import Setup
from hertzloop.views.format import unwrapped
from hertzloop.views.run import print_run
from hertzloop.views.run_json import run_as_json
from hertzloop.warmup import RUN, Work

# Parameters of the command that only separate processes need.
_OF_PROCESSES = ("name", "port", "timeout_s", "fast_lane", "realtime")


@dataclass(frozen=True)
class RunArguments:
    """What `hertzloop run` was called with. `options`: how the scene is run."""

    options: RunOptions
    scene: str
    settings: list[str]
    seed: int | None
    out_file: Path | None
    json_file: Path | None
    port: int | None
    live: bool


def run(
    context: typer.Context,
    transport: Annotated[
        Transport, typer.Option(help="Choose how the parts of the run communicate.")
    ] = Transport.ZENOH,
    overwrite: options.OverwriteOption = False,
    horizon: options.HorizonOption = None,
    name: options.NameOption = None,
    timeout_s: options.TimeoutOption = RunOptions.timeout_s,
    verify: Annotated[
        bool,
        typer.Option(
            "--verify", help="Repeat the closed loop with half the step and twice the modes."
        ),
    ] = False,
    fast_lane: options.FastLaneOption = True,
    realtime: options.RealtimeOption = "auto",
    pace: options.PaceOption = None,
    repeat: options.RepeatOption = None,
    controller: options.ControllerOption = None,
    note: options.NoteOption = "",
    scene: options.SceneArgument = DEFAULT,
    out_file: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write the recording to this file.")
    ] = None,
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    json_file: options.JsonOption = None,
    port: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=65533,
            help="Use this and the next two ports on loopback; by default, use private sockets.",
            rich_help_panel=options.EXPERT,
        ),
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="Show the run in a viewer while it is in progress.")
    ] = False,
    details: options.DetailsOption = False,
) -> None:
    """Run and record a scene, and compare it with the same run without control."""
    if transport is not Transport.ZENOH:
        check_unused(context, _OF_PROCESSES, f"with --transport {transport}")
    if transport is Transport.COMPILED:
        check_unused(context, {"horizon"}, "with --transport compiled")
    run_options = RunOptions(
        transport=transport,
        overwrite=overwrite,
        horizon=horizon,
        name=name,
        timeout_s=timeout_s,
        verify=verify,
        fast_lane=fast_lane,
        realtime=realtime,
        pace=pace,
        repeat=repeat,
        controller=controller,
        note=note,
    )
    arguments = RunArguments(
        run_options, scene, settings or [], seed, out_file, json_file, port, live
    )
    setup, recording = _checked(arguments)
    prepare.compile_first(setup, works=RUN if pace is None else [*RUN, Work.PACED])
    report = _run(arguments, setup, recording)
    linear_loop, warning = _linear_loop(setup, has_own_controller=controller is not None)
    data = run_as_json(report) | {"linear_loop": linear_loop}
    print_run(out, report, details, warning)
    outputs.write_json(json_file, data)
    if report.differs:
        raise typer.Exit(1)


def _checked(arguments: RunArguments) -> tuple[Setup, Path]:
    """Return the scene, and the recording to write; end the command if one of them cannot be."""
    asked, scene, settings = arguments.options, arguments.scene, arguments.settings
    repeat = asked.repeat
    if repeat is not None and (scene != DEFAULT or settings or arguments.seed is not None):
        fail("--repeat: the recording fixes scene and seed. Remove SCENE, --set and --seed.")
    repeated = read(repeat) if repeat else None
    if repeated:
        setup = scene_to_run(repeated)
    else:
        setup = prepare.scene_from(scene, settings, arguments.seed)
    recording = arguments.out_file or Path(f"{setup.name}{'-again' if repeat else ''}.mcap")
    inputs = [repeat] if repeat else outputs.files_of(setup, scene, *settings)
    outputs.check_recording(recording, asked.overwrite, read=inputs)
    outputs.check_json(arguments.json_file, recording)
    if asked.verify:
        check_verifiable(setup)
    if arguments.live:
        check_transport("--live", asked.transport)
    if asked.controller is not None:
        check_command(asked.controller)
    prepare.check_pace(setup, asked)
    if repeated is not None:
        repeat_or_fail(repeated, setup)  # before three processes are started for nothing
    return setup, recording


def _run(arguments: RunArguments, setup: Setup, recording: Path) -> RunReport:
    """Run and record the scene, with a progress bar, and with a viewer for --live."""
    with _meeting(arguments) as run_options:
        started_s = time.time()
        if run_options.transport is Transport.ZENOH:
            check_buildable(setup)  # so that the roles inherit what it loads
            fork_server.prepare()  # before anything starts a thread
        with (
            if_interrupted(lambda: what_is_kept(recording, started_s)),
            _viewer(run_options) if arguments.live else nullcontext(),
            progress(setup.name, setup.steps) as advance,
        ):
            return run_and_assess(setup, recording, run_options, advance)


@contextmanager
def _meeting(arguments: RunArguments) -> Iterator[RunOptions]:
    """Yield the run's options with the endpoints and the name that others have to know."""
    run_options, port = arguments.options, arguments.port
    endpoints, name = run_options.endpoints, run_options.name
    with ExitStack() as stack:
        if run_options.controller:
            endpoints = stack.enter_context(meeting_endpoints(run_options.controller, port))
            name = name_on_bus(run_options.controller, name)
        elif port:
            endpoints = on_loopback([port, port + 1, port + 2])
        if arguments.live:
            endpoints = endpoints or stack.enter_context(own_endpoints())
            name = name or f"live-{os.getpid()}-{secrets.token_hex(4)}"
        yield replace(run_options, endpoints=endpoints, name=name)


def _viewer(run_options: RunOptions) -> AbstractContextManager[None]:
    """Show the run in a viewer while the context lasts."""
    from hertzloop.processes.observer import observer_beside  # imports zenoh, 5 ms

    assert run_options.name is not None
    assert run_options.endpoints is not None
    return observer_beside(run_options.name, run_options.endpoints)


def _linear_loop(
    setup: Setup, has_own_controller: bool
) -> tuple[dict[str, Any] | None, Text | None]:
    """Return how the linear loop grows, as plain data, and a warning if it is not stable."""
    if not setup.has_law or loaded_law(setup).not_linear or has_own_controller:
        return None, None
    # The margin takes 0.06 s to import.
    from hertzloop.studies.margin.growth import growth_of
    from hertzloop.studies.margin.sentences import unstable_line

    try:
        growth = growth_of(setup)
    except Exception as error:  # whatever it is, the run has ended well
        return None, unwrapped(("Linear loop:", "bold red"), f" not analysed ({error!r}).")
    if growth is None:
        return None, None
    if growth.unstable_poles == 0:
        return asdict(growth), None
    head = "Linear loop:" if growth.unstable_poles is None else "Linear loop unstable:"
    return asdict(growth), unwrapped((head, "bold red"), f" {unstable_line(growth)}")
