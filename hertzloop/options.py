"""Options and checks that commands share."""

import json
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from hertzloop.scene import Scene, SceneError, load
from hertzloop.terminal import err, fail

SceneArgument = Annotated[str, typer.Argument(help="A shipped scene's name, or a .toml file.")]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", help="Change a scene key, e.g. sensors.bits=12.")
]
SeedOption = Annotated[
    int | None, typer.Option(help="Seed of all randomness; the scene's if left out.")
]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")]
HorizonOption = Annotated[
    int | None,
    typer.Option(min=1, help="Most steps between two exchanges; as the law allows if left out."),
]
TimeoutOption = Annotated[
    float, typer.Option(min=0.1, help="Longest wait for a message of another process, s.")
]
WaitOption = Annotated[
    float, typer.Option(min=0.1, help="Longest wait for the other processes to appear, s.")
]
NameOption = Annotated[str, typer.Option(help="Name of the run on the bus.")]
ListenOption = Annotated[list[str] | None, typer.Option(help="Endpoint to listen on.")]
ConnectOption = Annotated[list[str] | None, typer.Option(help="Endpoint to connect to.")]
ConfigOption = Annotated[
    Path | None,
    typer.Option(help="zenoh configuration (JSON5), e.g. for TLS and access control.", exists=True),
]
MachineOption = Annotated[bool, typer.Option("--machine", hidden=True)]
JsonOption = Annotated[Path | None, typer.Option("--json", help="Write all figures to this file.")]


TransportName = Literal["zenoh", "inprocess", "compiled"]


def scene_from(source: str, settings: list[str] | None, seed: int | None) -> Scene:
    """The scene a command works on; ends the command if it cannot be simulated."""
    try:
        scene = load(source, settings or (), seed)
        from hertzloop import parts

        parts.plant_spec(scene)
        return scene
    except SceneError as error:
        fail(str(error), 2)


def check_output(path: Path, overwrite: bool, option: str = "--out") -> None:
    """End the command unless `path` can be written, and may be."""
    if path.exists() and not path.is_file() and not overwrite:
        fail(f"{path} is no file that could be written to", 2)
    if path.is_file() and not overwrite:
        fail(f"{path} exists; choose another name with {option}, or allow it with --overwrite", 2)
    check_folder(path)


def check_folder(path: Path | None) -> None:
    """End the command if the folder of a file to write does not exist."""
    if path is not None and not path.parent.is_dir():
        fail(f"the folder {path.parent} does not exist", 2)


def write_json(path: Path | None, data: dict[str, Any]) -> None:
    """Write what --json asks for, if it does."""
    if path is None:
        return
    try:
        path.write_text(json.dumps(_strict(data), indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        fail(f"cannot write {path}: {error.strerror}", 1)


def _strict(data: Any) -> Any:
    """The same with null for numbers that JSON does not know."""
    if isinstance(data, dict):
        return {key: _strict(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_strict(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def announce_compilation() -> None:
    """Say why the next half minute is silent."""
    err.print("Compiling the kernels: once after every change of version, about half a minute.")
