"""The command line. Exit codes: 0 done, 1 a run failed or recordings differ, 2 the user's
mistake, 130 interrupted."""

import signal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hertzloop import study_commands, sweep_commands, tune_command
from hertzloop.options import (
    ConfigOption,
    ConnectOption,
    HorizonOption,
    JsonOption,
    ListenOption,
    MachineOption,
    NameOption,
    OverwriteOption,
    SceneArgument,
    SeedOption,
    SetOption,
    TimeoutOption,
    TransportName,
    WaitOption,
    announce_compilation,
    check_folder,
    check_output,
    scene_from,
    write_json,
)
from hertzloop.process_frame import bus_address, framed, progress_reporter
from hertzloop.scene import DEFAULT, SceneError, load, shipped
from hertzloop.terminal import err, fail, out, progress

if TYPE_CHECKING:
    from recordings.reader import Recording

app = typer.Typer(
    help="Try an active force law against an impact at 1 MHz, over a real message bus.",
    no_args_is_help=True,
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
        typer.Option(min=1, max=65533, help="First of three ports; free ones if left out."),
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the run on the bus.")] = None,
    timeout: TimeoutOption = 5.0,
    verify: Annotated[
        bool, typer.Option("--verify", help="Repeat with half the step and twice the modes.")
    ] = False,
) -> None:
    """Run a scene, record it, and print what happened with and without control."""
    from hertzloop.warmup import ensure_compiled

    resolved = scene_from(scene, settings, seed)
    recording = out_file or Path(f"{resolved.name}.mcap")
    check_output(recording, overwrite)
    check_folder(json_file)
    if verify and resolved.run.scheme == "thesis2008":
        fail("--verify needs a scheme that converges; run.scheme = 'thesis2008' does not", 2)
    ensure_compiled(announce_compilation, resolved.run.scheme)

    from bus.port import BusError
    from bus.streams import StreamFault
    from hertzloop import report
    from hertzloop.launcher import RunFailed
    from hertzloop.run import RunOptions, Transport, run_scene
    from recordings.writer import RecordingError

    options = RunOptions(
        transport=Transport(transport),
        overwrite=overwrite,
        horizon=horizon,
        ports=[port, port + 1, port + 2] if port else None,
        name=name,
        timeout_s=timeout,
        verify=verify,
    )
    try:
        with progress(resolved.name, resolved.steps) as advance:
            data = run_scene(resolved, recording, options, advance)
    except KeyboardInterrupt:
        err.print(f"interrupted; what was recorded until now is in {recording}")
        raise typer.Exit(130) from None
    except SceneError as error:
        fail(str(error), 2)
    except (RunFailed, BusError, StreamFault, RecordingError) as error:
        fail(str(error), 1)
    report.print_run(out, data)
    write_json(json_file, data)


@app.command()
def plant(
    scene: SceneArgument = DEFAULT,
    settings: SetOption = None,
    seed: SeedOption = None,
    horizon: HorizonOption = None,
    name: NameOption = "hertzloop",
    listen: ListenOption = None,
    connect: ConnectOption = None,
    zenoh_config: ConfigOption = None,
    timeout: TimeoutOption = 5.0,
    wait: WaitOption = 30.0,
    machine: MachineOption = False,
) -> None:
    """The plant process alone: waits for controller and recorder, then runs the scene."""
    from bus.streams import PLANT
    from hertzloop import processes
    from hertzloop.warmup import ensure_compiled

    resolved = scene_from(scene, settings, seed)
    ensure_compiled(announce_compilation, resolved.run.scheme)
    with framed(PLANT, machine) as tell:
        address = bus_address(PLANT, name, listen, connect, zenoh_config, timeout, wait)
        if not machine:
            err.print(f"plant on {', '.join(address.listen)}: waiting for controller and recorder")
        stats = processes.run_plant(
            resolved, address, horizon, lambda: tell(ready=True), progress_reporter(tell)
        )
        tell(done=stats)
        if not machine:
            out.print(f"{resolved.steps:,} steps in {stats['wall_s']:.3f} s")


@app.command()
def controller(
    name: NameOption = "hertzloop",
    listen: ListenOption = None,
    connect: ConnectOption = None,
    zenoh_config: ConfigOption = None,
    timeout: TimeoutOption = 5.0,
    wait: WaitOption = 30.0,
    machine: MachineOption = False,
) -> None:
    """The controller process alone: takes the scene from the plant, answers its samples."""
    from bus.streams import CONTROLLER
    from hertzloop import processes
    from hertzloop.warmup import ensure_compiled

    ensure_compiled(announce_compilation)
    with framed(CONTROLLER, machine) as tell:
        address = bus_address(CONTROLLER, name, listen, connect, zenoh_config, timeout, wait)
        if not machine:
            err.print(f"controller on {', '.join(address.listen)}: waiting for plant and recorder")
        tell(done=processes.run_controller(address, lambda: tell(ready=True)))


@app.command()
def record(
    out_file: Annotated[Path, typer.Option("--out", help="Recording to write.")] = Path("run.mcap"),
    overwrite: OverwriteOption = False,
    name: NameOption = "hertzloop",
    listen: ListenOption = None,
    connect: ConnectOption = None,
    zenoh_config: ConfigOption = None,
    timeout: TimeoutOption = 5.0,
    wait: WaitOption = 30.0,
    machine: MachineOption = False,
) -> None:
    """The recorder process alone: writes every stream of a run into one MCAP file."""
    from bus.streams import RECORDER
    from hertzloop import processes

    check_output(out_file, overwrite)
    with framed(RECORDER, machine) as tell:
        address = bus_address(RECORDER, name, listen, connect, zenoh_config, timeout, wait)
        if not machine:
            err.print(f"recorder on {', '.join(address.listen)}: waiting for plant and controller")
        stats = processes.run_recorder(out_file, address, overwrite, lambda: tell(ready=True))
        tell(done=stats)
        if not machine:
            out.print(f"recorded {out_file}")


def _read(path: Path) -> "Recording":
    from recordings.reader import read
    from recordings.writer import RecordingError

    try:
        return read(path)
    except RecordingError as error:
        fail(str(error), 2)


FileArgument = Annotated[Path, typer.Argument(help="A recording.", metavar="F.mcap")]


@app.command()
def inspect(file: FileArgument, json_file: JsonOption = None) -> None:
    """Streams, counts, gaps, scene and figures of a recording, whole or cut off."""
    from hertzloop import inspection

    recording = _read(file)
    data = inspection.summary(recording)
    inspection.show(out, recording, data)
    write_json(json_file, data)


@app.command()
def compare(
    a: Annotated[Path, typer.Argument(metavar="A.mcap")],
    b: Annotated[Path, typer.Argument(metavar="B.mcap")],
    tolerance: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=1.0,
            help="Allowed difference as a share of a field's largest value; for runs on "
            "different processors, 1e-9 say.",
        ),
    ] = 0.0,
) -> None:
    """Exit 0 if every compared stream of two recordings has the same bytes, else 1."""
    from recordings.compare import first_difference

    left, right = _read(a), _read(b)
    for recording in (left, right):
        for problem in recording.problems:
            err.print(f"{recording.path}: {problem}", soft_wrap=True)
    difference = first_difference(left, right, tolerance)
    if difference:
        out.print(difference, soft_wrap=True)
        raise typer.Exit(1)
    within = f" within {tolerance:g} of the largest" if tolerance else ""
    out.print(
        f"the same{within}: {left.truth.samples:,} steps of truth, {left.daq.samples:,} samples, "
        f"{left.force.samples:,} forces, {len(left.events)} events"
    )


@app.command()
def replay(
    file: FileArgument,
    save: Annotated[
        Path | None, typer.Option(help="Write an .rrd file for the Rerun viewer.", metavar="F.rrd")
    ] = None,
    screenshot: Annotated[
        Path | None,
        typer.Option(
            help="Write a picture of the first contact; no screen needed.", metavar="F.png"
        ),
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Watch a recording in slow motion: plate, forces, events. Opens a window by default."""
    for option, output in (("--save", save), ("--screenshot", screenshot)):
        if output is not None:
            check_output(output, overwrite, option)
    recording = _read(file)

    # Here and not above: Rerun takes a second to load, and only a replay needs it.
    from hertzloop import replaying
    from recordings.writer import RecordingError

    if save is None and screenshot is None and not replaying.has_display():
        fail(
            "there is no screen to open a window on; write a picture with --screenshot F.png, "
            "or a file for the Rerun viewer elsewhere with --save F.rrd",
            2,
        )
    for problem in recording.problems:
        err.print(f"{file}: {problem}", soft_wrap=True)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        replaying.replay(recording, save, screenshot)
    except KeyboardInterrupt:
        raise typer.Exit(130) from None
    except RecordingError as error:
        fail(str(error), 1)
    for output in (save, screenshot):
        if output is not None:
            out.print(f"written: {output}", soft_wrap=True)


@app.command()
def recover(
    file: FileArgument,
    out_file: Annotated[
        Path | None, typer.Option("--out", help="New file; F-recovered.mcap if left out.")
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Make a whole file of a recording that was cut off, so that any MCAP tool opens it."""
    from recordings.recovery import recover as recover_file
    from recordings.writer import RecordingError

    whole = out_file or file.with_name(f"{file.stem}-recovered.mcap")
    check_output(whole, overwrite)
    try:
        messages = recover_file(file, whole, overwrite)
    except RecordingError as error:
        fail(str(error), 2)
    out.print(f"recovered {messages:,} messages into {whole}", soft_wrap=True)


@app.command()
def scenes() -> None:
    """The scenes that come with hertzloop, and what each shows."""
    for name in shipped():
        note = " (default)" if name == DEFAULT else ""
        out.print(f"[bold]{name}[/bold]{note}\n    {load(name).shows}", soft_wrap=True)


study_commands.register(app)
sweep_commands.register(app)
app.command()(tune_command.tune)


def main() -> None:
    """Entry point."""
    app()
