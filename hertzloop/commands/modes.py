"""The command `modes`: what a scene strikes as a file of modes, to look at, change and rerun."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from hertzloop.commands.options import (
    OverwriteOption,
    SceneArgument,
    SetOption,
    check_output,
    files_of,
    scene_from,
)
from hertzloop.commands.terminal import fail, out
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import DEFAULT
from plant.structures.mode_file import SUFFIXES, write_modes


def modes(
    scene: SceneArgument = DEFAULT,
    out_file: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="File to write, .csv, .parquet or .npz."),
    ] = None,
    settings: SetOption = None,
    grid: Annotated[
        bool, typer.Option("--grid", help="With shapes on a grid, for the replay; .npz only.")
    ] = False,
    overwrite: OverwriteOption = False,
) -> None:
    """Write the modes that a scene's plant computes with, as plate.modes reads them."""
    resolved = scene_from(scene, settings, None)
    target = out_file or Path(f"{resolved.name}-modes.csv")
    if target.suffix not in SUFFIXES:
        fail(f"{target} is none of {', '.join(SUFFIXES)}, which say how to write the modes", 2)
    if grid and target.suffix != ".npz":
        fail(f"{target} cannot hold shapes on a grid; take an .npz for --grid", 2)
    check_output(target, overwrite, read=files_of(resolved, scene, *(settings or [])))
    from hertzloop.analysis.deflection import modes_of_scene

    try:
        table = modes_of_scene(resolved, grid)
    except SceneError as error:
        fail(str(error), 2)
    try:
        target.write_bytes(write_modes(target.suffix, table))
    except OSError as error:
        fail(f"cannot write {target}: {error.strerror}", 1)
    out.print(
        f"{len(table.omega_rad_s)} modes up to {table.omega_rad_s[-1] / (2 * np.pi):.4g} Hz (modes "
        "of equal frequency merged, modes that no force moves left out), and a residual "
        f"flexibility of {table.residual_flexibility_m_n:.4g} m/N; written: {target}",
        soft_wrap=True,
    )


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(modes)
