"""Options that several commands have, declared once for their signatures."""

from pathlib import Path
from typing import Annotated, Literal

import typer

# A scene, and what is simulated of it.
SceneArgument = Annotated[str, typer.Argument(help="Name of a shipped scene, or a .toml file.")]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", help="Change a scene key, for example sensors.bits=12.")
]
SeedOption = Annotated[
    int | None, typer.Option(help="Set the random seed; default: run.seed of the scene.")
]
SpanOption = Annotated[
    Literal["impact", "run"], typer.Option(help="Evaluate the first impact or the whole run.")
]

# Input and output.
FileArgument = Annotated[Path, typer.Argument(help="Recording to read.", metavar="F.mcap")]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")]
JsonOption = Annotated[
    Path | None,
    typer.Option(
        "--json",
        help="Write all metrics as JSON to this file and replace it; -: standard output.",
    ),
]
DetailsOption = Annotated[
    bool, typer.Option("--details", help="Print all tables, metrics and warnings.")
]

# How a run is done, as a whole or by one of its processes.
EXPERT = "Expert options"  # heading of those that few runs need
HorizonOption = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Exchange data after at most this many steps; default: as the law allows.",
        rich_help_panel=EXPERT,
    ),
]
NameOption = Annotated[
    str | None, typer.Option(help="Set the name of the run on the bus.", rich_help_panel=EXPERT)
]
TimeoutOption = Annotated[
    float,
    typer.Option(
        "--timeout",
        min=0.1,
        max=1_000_000,
        help="Stop waiting for a message of another process after this time, s.",
        rich_help_panel=EXPERT,
    ),
]
FastLaneOption = Annotated[
    bool,
    typer.Option(
        "--fast-lane/--no-fast-lane",
        help="Exchange data between plant and controller on one host in shared memory.",
        rich_help_panel=EXPERT,
    ),
]
RealtimeOption = Annotated[
    Literal["auto", "on", "off"],
    typer.Option(
        help="Use real-time scheduling; auto: where it is permitted and a core is idle.",
        rich_help_panel=EXPERT,
    ),
]
PaceOption = Annotated[
    float | None,
    typer.Option(
        min=1e-9,
        max=1000,
        help="Follow the wall clock at this ratio of simulated to wall time, without waiting for "
        "forces; default: lock-step.",
    ),
]
RepeatOption = Annotated[
    Path | None,
    typer.Option(
        metavar="F.mcap",
        help="Repeat a recorded run in lock-step with the recorded forces and delays.",
    ),
]
ControllerOption = Annotated[
    str | None,
    typer.Option(
        metavar="'CMD ...'",
        help="Start this command line as the controller; {name}, {listen} and {connect} in it are "
        "filled in.",
        rich_help_panel=EXPERT,
    ),
]

NoteOption = Annotated[
    str, typer.Option(metavar="TEXT", help="Write this note, one line, into the recording.")
]

# Where one process of a run meets the others.
ListenOption = Annotated[list[str] | None, typer.Option(help="Listen on this endpoint.")]
ConnectOption = Annotated[list[str] | None, typer.Option(help="Connect to this endpoint.")]
ZenohConfigOption = Annotated[
    Path | None,
    typer.Option(exists=True, help="Read the zenoh configuration from this JSON5 file."),
]
WaitOption = Annotated[
    float,
    typer.Option(
        "--wait",
        min=0.1,
        max=1_000_000,
        help="Stop waiting for other processes to appear after this time, s.",
    ),
]
MachineOption = Annotated[bool, typer.Option("--machine", hidden=True)]  # given by a launcher
