"""The command `scene modes`: the modes of a structure as a file that a scene can read."""

from pathlib import Path
from typing import Annotated

import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.terminal import fail, out
from hertzloop.common.atomic_files import atomic_write
from hertzloop.plant.structures.mode_file import write_modes
from hertzloop.results.scene_modes import modes_of_scene

_SUFFIXES = (".csv", ".npz")


def modes(
    scene: options.SceneArgument,
    out_file: Annotated[Path, typer.Option("--out", "-o", help="Write this .csv or .npz file.")],
    settings: options.SetOption = None,
    overwrite: options.OverwriteOption = False,
) -> None:
    """Write the modes of a scene's structure to a file.

    The key plate.modes of a scene reads this file.
    """
    if out_file.suffix not in _SUFFIXES:
        fail(f"--out = {out_file}: unknown format. Use a name that ends in .csv or .npz.")
    setup = prepare.scene_from(scene, settings, None)
    read = outputs.files_of(setup, scene, *(settings or []))
    outputs.check_output(out_file, overwrite, read=read)
    table = modes_of_scene(setup)
    atomic_write(out_file, write_modes(out_file.suffix, table))
    out.say(
        f"{len(table.omega_rad_s)} modes (modes of equal frequency merged, modes without "
        f"participation dropped), and a residual flexibility of "
        f"{table.residual_flexibility_m_n:.4g} m/N; written: {out_file}"
    )
