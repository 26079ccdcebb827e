"""The command `run`."""

import os
import secrets
import time
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from hertzloop.bus.sockets import on_loopback, own_endpoints
from hertzloop.cli import options
from hertzloop.cli.recordings import repeat_or_fail, scene_to_run
from hertzloop.cli.terminal import fail, if_interrupted, out, progress
from hertzloop.loop.run_options import PROCESSES, RunOptions, Transport
from hertzloop.processes import fork_server
from hertzloop.processes.program import BUS_NAME, check_command, meeting_endpoints
from hertzloop.processes.record import what_is_kept
from hertzloop.recordings.reader import read
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.results.verification import check_verifiable
from hertzloop.scene.controller import check_buildable, loaded_law
from hertzloop.scene.loading import DEFAULT
from hertzloop.views.format import unwrapped
from hertzloop.views.run import print_run
from hertzloop.views.run_json import run_as_json


@options.takes(realtime="auto")
def run(
    request: RunOptions,
    scene: options.SceneArgument = DEFAULT,
    out_file: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    json_file: options.JsonOption = None,
    port: Annotated[int | None, typer.Option(min=1, max=65533)] = None,
    live: bool = False,
    details: options.DetailsOption = False,
) -> None:
    """Run and record a scene, and compare it with the same run without control.

    Args:
        out_file: Write the recording to this file.
        port: Use this and the next two ports on loopback; by default, use private sockets.
        live: Show the run in a viewer while it is in progress.
    """
    repeat = request.repeat
    if repeat is not None and (scene != DEFAULT or settings or seed is not None):
        fail("--repeat: the recording fixes scene and seed. Remove SCENE, --set and --seed.")
    repeated = read(repeat) if repeat else None
    resolved = scene_to_run(repeated) if repeated else options.scene_from(scene, settings, seed)
    recording = out_file or Path(f"{resolved.name}{'-again' if repeat else ''}.mcap")
    inputs = [repeat] if repeat else options.files_of(resolved, scene, *(settings or []))
    options.check_recording(recording, request.overwrite, read=inputs)
    options.check_json(json_file, recording)
    if request.verify:
        check_verifiable(resolved)
    needing = [*(["live"] if live else []), *options.given_that_need(request, PROCESSES)]
    for option in needing if request.transport is not Transport.ZENOH else ():
        fail(
            f"--{option}: not available with --transport {request.transport}. Use --transport "
            "zenoh."
        )
    if request.controller is not None:
        check_command(request.controller)
    options.check_pace(resolved, request)
    if repeated is not None:
        repeat_or_fail(repeated, resolved)  # before three processes are started for nothing
    options.compile_first(resolved, paced=request.pace is not None)

    endpoints = on_loopback([port, port + 1, port + 2]) if port else None
    held, name = ExitStack(), request.name
    if request.controller:
        endpoints = held.enter_context(meeting_endpoints(request.controller, port))
        name = name or (None if "{name}" in request.controller else BUS_NAME)
    observer: AbstractContextManager[object] = nullcontext()
    if live:
        from hertzloop.processes.observer import observer_beside  # imports zenoh, 5 ms

        endpoints = endpoints or held.enter_context(own_endpoints())
        name = name or f"live-{os.getpid()}-{secrets.token_hex(4)}"
        observer = observer_beside(name, endpoints)
    request = replace(request, endpoints=endpoints, name=name)
    started_s = time.time()
    if request.transport is Transport.ZENOH:
        check_buildable(resolved)  # so that the roles inherit what it loads
        fork_server.prepare()  # before anything starts a thread
    with (
        if_interrupted(lambda: what_is_kept(recording, started_s)),
        held,
        observer,
        progress(resolved.name, resolved.steps) as advance,
    ):
        report = run_and_assess(resolved, recording, request, advance)
    growth = warning = None
    if (
        resolved.has_law and not loaded_law(resolved).not_linear and not request.controller
    ):  # the margin takes 0.06 s to import
        from hertzloop.studies.margin.margin import growth_of
        from hertzloop.studies.margin.shown import unstable_line

        try:
            growth = growth_of(resolved)
        except Exception as error:  # whatever it is, the run has ended well
            warning = unwrapped(("Linear loop:", "bold red"), f" not analysed ({error!r}).")
    if growth is not None and growth.unstable_poles != 0:
        undecided = growth.unstable_poles is None
        head = "Linear loop:" if undecided else "Linear loop unstable:"
        warning = unwrapped((head, "bold red"), f" {unstable_line(growth)}")
    linear = {"linear_loop": None if growth is None else asdict(growth)}
    data = run_as_json(report) | linear
    print_run(out, report, details, warning)
    options.write_json(json_file, data)
    if report.differs:
        raise typer.Exit(1)
