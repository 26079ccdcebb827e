"""The command `modes`: what a scene strikes as a file of modes, to look at, change and rerun."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from hertzloop.setup import Setup
from plant.structures.mode_file import SUFFIXES, ModeTable, write_modes

if TYPE_CHECKING:
    from plant.plant import PlantSpec

_NODES = 441  # of the grid, about
_GRID_MODES = 1200  # at most that many modes go onto a grid


def modes_of_scene(setup: Setup, grid: bool = False) -> ModeTable:
    """Return the modes that a scene's plant computes with, up to its limit: those of equal
    frequency merged, without those that no force moves. With `grid`: their shapes on a grid, too.

    The same run with them gives the same bytes. Raises SceneError.
    """
    from plant.plant import air_eta
    from plant.schemes.collocation import residual_m_n
    from plant.structures.structure import oscillators

    spec = setup.plant
    if spec.infinite_plate:
        raise SceneError(
            "the scene takes an infinite plate, which has no modes; set run.plate_model = 'modal'"
        )
    limit = 2.0 * np.pi * spec.frequency_limit_hz
    points = spec.contact_point_m, spec.actuator_point_m
    try:
        modes = oscillators(spec.plate, *points, limit)
    except ValueError as error:
        raise SceneError(str(error)) from error
    count = len(modes.omega)
    return ModeTable(
        modes.omega,
        modes.eta + air_eta(spec, modes.omega),
        np.full(count, modes.scale_per_kg),
        modes.contact,
        modes.actuator,
        residual_m_n(spec),
        _on_grid(spec, limit, count) if grid else None,
    )


def _on_grid(
    spec: "PlantSpec", limit: float, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    from hertzloop.results.deflection import axes
    from plant.structures.structure import oscillator_shapes

    what, points = spec.plate, (spec.contact_point_m, spec.actuator_point_m)
    if what.size_m is None:
        if what.mode_table is not None:
            raise SceneError("the modes come from a file; take its own grid")
        raise SceneError(f"{what} has no shapes on a grid; leave out --grid")
    if count > _GRID_MODES:
        raise SceneError(
            f"{count} modes are too many for shapes on a grid, the most is {_GRID_MODES}; take a "
            "larger run.accuracy"
        )
    x, y = axes(what.size_m, points[0], _NODES)
    return x, y, oscillator_shapes(what, *points, limit, what.on_grid(limit, x, y))


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
        f"{len(table.omega_rad_s)} modes up to {table.omega_rad_s[-1] / (2 * np.pi):.4g} Hz (modes "
        "of equal frequency merged, modes that no force moves left out), and a residual "
        f"flexibility of {table.residual_flexibility_m_n:.4g} m/N; written: {target}",
        soft_wrap=True,
    )


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(modes)
