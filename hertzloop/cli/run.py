"""The command `run`."""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from hertzloop.bus.sockets import on_loopback
from hertzloop.cli import outputs, prepare
from hertzloop.cli.options import (
    DetailsOption,
    JsonOption,
    SceneArgument,
    SeedOption,
    SetOption,
    check_unused,
    run_options,
)
from hertzloop.cli.recordings import repeat_or_fail, scene_to_run
from hertzloop.cli.terminal import err, fail, if_interrupted, out, progress
from hertzloop.loop.run_options import EXPERT, USES, RunOptions, Transport, check_transport
from hertzloop.processes.launcher import Launcher
from hertzloop.processes.program import check_command, meeting_endpoints, name_on_bus
from hertzloop.processes.record import what_is_kept
from hertzloop.recordings.reader import read
from hertzloop.results.assessed_run import RunReport, run_and_assess
from hertzloop.results.verification import check_verifiable
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.setup import Setup
from hertzloop.views.format import unwrapped
from hertzloop.views.report import print_run
from hertzloop.views.run_json import run_as_json

_MANY_STEPS = 4_000_000
_BYTES_A_STEP = 250  # of the run, the same without control, and a repetition


@run_options(realtime="auto")
def run(
    context: typer.Context,
    scene: SceneArgument = DEFAULT,
    out_file: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write the recording to this file.")
    ] = None,
    seed: SeedOption = None,
    settings: SetOption = None,
    json_file: JsonOption = None,
    port: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=65533,
            help="Use this and the next two ports on loopback; by default, use private sockets.",
            rich_help_panel=EXPERT,
        ),
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="Show the run in a viewer while it is in progress.")
    ] = False,
    details: DetailsOption = False,
    *,
    options: RunOptions,
) -> None:
    """Run and record a scene, and compare it with the same run without control."""
    unused = [name for name, use in USES.items() if options.transport not in use.transports]
    if options.transport is not Transport.ZENOH:
        unused.append("port")
    check_unused(context, unused, f"with --transport {options.transport}")
    if live:
        check_transport("--live", options.transport)
    setup, recording = _checked(options, scene, settings or [], seed, out_file)
    outputs.check_json(json_file, recording)
    prepare.compile_first(setup)
    with _meeting(options, port) as met:
        report = _run(setup, recording, met, live)
    linear_loop, warning = _linear_loop(setup, has_own_controller=options.controller is not None)
    data = run_as_json(report) | {"linear_loop": linear_loop}
    print_run(out, report, details, warning)
    outputs.write_json(json_file, data)
    if report.differs:
        raise typer.Exit(1)


def _checked(
    options: RunOptions, scene: str, settings: list[str], seed: int | None, out_file: Path | None
) -> tuple[Setup, Path]:
    """Return the scene, and the recording to write; end the command if one of them cannot be."""
    repeat = options.repeat
    if repeat is not None and (scene != DEFAULT or settings or seed is not None):
        fail("--repeat: the recording fixes scene and seed. Remove SCENE, --set and --seed.")
    repeated = read(repeat) if repeat else None
    setup = scene_to_run(repeated) if repeated else prepare.scene_from(scene, settings, seed)
    recording = out_file or Path(f"{setup.scene.name}{'-again' if repeat else ''}.mcap")
    inputs = [repeat] if repeat else outputs.files_of(setup, scene, *settings)
    outputs.check_recording(recording, options.overwrite, read=inputs)
    if options.verify:
        check_verifiable(setup)
    if options.controller is not None:
        check_command(options.controller)
    prepare.check_pace(setup, options)
    if setup.run.steps > _MANY_STEPS:
        needed_gb = 1e-9 * _BYTES_A_STEP * setup.run.steps
        err.say(f"{setup.run.steps:,} steps: the metrics need about {needed_gb:.2g} GB of memory.")
    if repeated is not None:
        repeat_or_fail(repeated, setup)  # before three processes are started for nothing
    return setup, recording


def _run(setup: Setup, recording: Path, options: RunOptions, live: bool) -> RunReport:
    """Run and record the scene, with a progress bar, and with a viewer if it is live."""
    started_s = time.time()

    @contextmanager
    def shown(launcher: Launcher | None) -> Iterator[Callable[[int], None]]:
        with (
            _viewer(launcher) if launcher and live else nullcontext(),
            progress(setup.scene.name, setup.run.steps) as advance,
        ):
            yield advance

    with if_interrupted(lambda: what_is_kept(recording, started_s)):
        return run_and_assess(setup, recording, options, shown)


@contextmanager
def _meeting(options: RunOptions, port: int | None) -> Iterator[RunOptions]:
    """Yield the run's options with the endpoints and the name that others have to know."""
    if options.controller:
        name = name_on_bus(options.controller, options.name)
        with meeting_endpoints(options.controller, port) as endpoints:
            yield options.model_copy(update={"endpoints": endpoints, "name": name})
    elif port:
        endpoints = on_loopback([port, port + 1, port + 2])
        yield options.model_copy(update={"endpoints": endpoints})
    else:
        yield options


def _viewer(launcher: Launcher) -> AbstractContextManager[None]:
    """Show a run in a viewer while the context lasts."""
    from hertzloop.processes.observer import observer_beside  # imports zenoh, 5 ms

    return observer_beside(launcher.name, launcher.endpoints)


def _linear_loop(
    setup: Setup, has_own_controller: bool
) -> tuple[dict[str, Any] | None, Text | None]:
    """Return how the linear loop grows, as plain data, and a warning if it is not stable."""
    if not setup.scene.controller.has_law or loaded_law(setup).not_linear or has_own_controller:
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
