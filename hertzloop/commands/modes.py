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
from hertzloop.scenes.scene import DEFAULT, Scene, SceneError
from plant.structures.mode_file import SUFFIXES, ModeTable, write_modes

_NODES = 441  # of the grid, about
_GRID_MODES = 1200  # at most that many modes go onto a grid


def modes_of_scene(scene: Scene, grid: bool = False) -> ModeTable:
    """The modes that a scene's plant has, up to its limit, silent ones included; with `grid`, the
    shapes on a grid too. The same run with them gives the same bytes. Raises SceneError."""
    from hertzloop import assembly as parts
    from plant.plant import air_eta
    from plant.schemes.collocation import residual_m_n

    spec = parts.plant_spec(scene)
    if spec.infinite_plate:
        raise SceneError(
            "the scene takes an infinite plate, which has no modes; set run.plate_model = 'modal'"
        )
    limit = 2.0 * np.pi * spec.frequency_limit_hz
    modes = spec.plate.modes(limit, spec.contact_point_m, spec.actuator_point_m)
    count = len(modes.omega)
    return ModeTable(
        modes.omega,
        modes.eta + air_eta(spec, modes.omega),
        np.full(count, modes.scale_per_kg),
        modes.at_contact,
        modes.at_actuator,
        residual_m_n(spec),
        _on_grid(scene, limit, count) if grid else None,
    )


def _on_grid(scene: Scene, limit: float, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    from hertzloop.results.deflection import axes
    from hertzloop.struck import structure
    from plant.structures.edged_plate import EdgedPlate
    from plant.structures.plate import Plate
    from plant.structures.solid_plate import SolidPlate

    what = structure(scene)
    if not isinstance(what, Plate | EdgedPlate | SolidPlate):
        raise SceneError("the modes come from a file; take its own grid")
    if count > _GRID_MODES:
        raise SceneError(
            f"{count} modes are too many for shapes on a grid, the most is {_GRID_MODES}; take a "
            "larger run.accuracy"
        )
    x, y = axes(what.size_m, scene.plate.points_m[0], _NODES)
    return x, y, what.on_grid(limit, x, y)


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
    try:
        table = modes_of_scene(resolved, grid)
    except SceneError as error:
        fail(str(error), 2)
    try:
        target.write_bytes(write_modes(target.suffix, table))
    except OSError as error:
        fail(f"cannot write {target}: {error.strerror}", 1)
    out.print(
        f"{len(table.omega_rad_s)} modes up to {table.omega_rad_s[-1] / (2 * np.pi):.4g} Hz, and a "
        f"residual flexibility of {table.residual_flexibility_m_n:.4g} m/N; written: {target}",
        soft_wrap=True,
    )


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(modes)
