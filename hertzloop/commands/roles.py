"""Commands of single processes, for terminals or hosts of their own: plant, controller, record."""

from pathlib import Path
from typing import Annotated, Any

import typer

from hertzloop.commands.options import (
    ConfigOption,
    ConnectOption,
    FastLaneOption,
    HorizonOption,
    ListenOption,
    MachineOption,
    NameOption,
    OverwriteOption,
    PaceOption,
    RealtimeOption,
    SceneArgument,
    SeedOption,
    SetOption,
    TimeoutOption,
    WaitOption,
    check_pace,
    check_recording,
    scene_from,
)
from hertzloop.commands.process_frame import bus_address, framed, progress_reporter, where
from hertzloop.commands.recordings import read_or_fail, repeat_or_fail
from hertzloop.commands.terminal import err, out
from hertzloop.processes.realtime import Wanted
from hertzloop.scenes.scene import DEFAULT


def say_profile(stats: dict[str, Any]) -> None:
    """One line on what was granted."""
    err.print(f"real-time profile: {stats['realtime']}", soft_wrap=True, markup=False)


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
    fast_lane: FastLaneOption = True,
    realtime: RealtimeOption = "auto",
    pace: PaceOption = None,
    repeat: Annotated[
        Path | None, typer.Option(help="A recording of this scene whose forces act again.")
    ] = None,
    machine: MachineOption = False,
) -> None:
    """The plant process alone: waits for controller and recorder, then runs the scene."""
    from bus.streams import PLANT
    from hertzloop.processes import roles

    resolved = scene_from(scene, settings, seed, tried=machine)
    check_pace(resolved, pace, timeout, horizon=horizon, repeat=repeat)
    repeated = repeat_or_fail(read_or_fail(repeat), resolved) if repeat else None
    with framed(PLANT, machine) as tell:
        address = bus_address(PLANT, name, listen, connect, zenoh_config, timeout, wait)
        if not machine:
            err.print(f"plant on {where(address)}: waiting for controller and recorder")
        stats = roles.run_plant(
            resolved,
            address,
            horizon,
            lambda: tell(ready=True),
            progress_reporter(tell),
            fast_lane,
            Wanted(realtime),
            pace,
            repeated,
        )
        tell(done=stats)
        if not machine:
            say_profile(stats)
            out.print(f"{resolved.steps:,} steps in {stats['wall_s']:.3f} s")


def controller(
    law: Annotated[
        str | None,
        typer.Option(help="Where this side has its law, if not where the scene says."),
    ] = None,
    name: NameOption = "hertzloop",
    listen: ListenOption = None,
    connect: ConnectOption = None,
    zenoh_config: ConfigOption = None,
    timeout: TimeoutOption = 5.0,
    wait: WaitOption = 30.0,
    fast_lane: FastLaneOption = True,
    realtime: RealtimeOption = "auto",
    machine: MachineOption = False,
) -> None:
    """The controller process alone: takes the scene from the plant, answers its samples."""
    from bus.streams import CONTROLLER
    from hertzloop.processes import roles

    with framed(CONTROLLER, machine) as tell:
        address = bus_address(CONTROLLER, name, listen, connect, zenoh_config, timeout, wait)
        if not machine:
            err.print(f"controller on {where(address)}: waiting for plant and recorder")
        stats = roles.run_controller(
            address, lambda: tell(ready=True), law, fast_lane, Wanted(realtime)
        )
        tell(done=stats)
        if not machine:
            say_profile(stats)


def record(
    out_file: Annotated[Path, typer.Option("--out", help="Recording to write.")] = Path("run.mcap"),
    overwrite: OverwriteOption = False,
    name: NameOption = "hertzloop",
    listen: ListenOption = None,
    connect: ConnectOption = None,
    zenoh_config: ConfigOption = None,
    timeout: TimeoutOption = 5.0,
    wait: WaitOption = 30.0,
    realtime: RealtimeOption = "auto",
    machine: MachineOption = False,
) -> None:
    """The recorder process alone: writes every stream of a run into one MCAP file."""
    from bus.streams import RECORDER
    from hertzloop.processes import roles

    check_recording(out_file, overwrite)
    with framed(RECORDER, machine) as tell:
        address = bus_address(RECORDER, name, listen, connect, zenoh_config, timeout, wait)
        if not machine:
            err.print(f"recorder on {where(address)}: waiting for plant and controller")
        stats = roles.run_recorder(
            out_file, address, overwrite, lambda: tell(ready=True), Wanted(realtime)
        )
        tell(done=stats)
        if not machine:
            out.print(f"recorded {out_file}")


def register(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (plant, controller, record):
        app.command()(command)
