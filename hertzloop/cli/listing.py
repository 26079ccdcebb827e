"""Commands that list scenes, keys, modes and the version."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from hertzloop import __version__
from hertzloop.cli.hosts import write_keys
from hertzloop.cli.options import (
    OverwriteOption,
    SceneArgument,
    SetOption,
    check_output,
    fail,
    files_of,
    out,
    scene_from,
)
from hertzloop.plant.structures.mode_file import SUFFIXES, write_modes
from hertzloop.scenes.errors import SceneError, shown
from hertzloop.scenes.scene import DEFAULT, shipped, shipped_text
from hertzloop.setup import load
from hertzloop.views.format import Table, styled


def scenes(
    name: Annotated[
        str | None, typer.Argument(help="Print this one, as a file to start from.")
    ] = None,
) -> None:
    """The scenes that come with hertzloop, and what each shows; or one of them as TOML."""
    if name is not None:
        if name not in shipped():
            fail(f"there is no scene {shown(name)}; known are {', '.join(shipped())}", 2)
        print(shipped_text(name), end="")
        return
    for one in shipped():
        note = " (default)" if one == DEFAULT else ""
        out.print(styled((one, "bold"), f"{note}\n    {load(one).description}"), soft_wrap=True)


def keys(
    part: Annotated[
        str, typer.Argument(help="Only keys that contain this; with --hosts, a new folder.")
    ] = "",
    hosts: Annotated[
        str | None,
        typer.Option(
            help="Write certificates and configurations for these hosts into the folder instead.",
            metavar="plant=A,controller=B,recorder=C",
        ),
    ] = None,
    days: Annotated[
        int, typer.Option(min=1, max=36500, help="How long the certificates of --hosts are valid.")
    ] = 365,
    law: Annotated[str | None, typer.Option(help="Only the keys of this law.")] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="As a page.")] = False,
) -> None:
    """All keys of a scene: what they take, unit, default and meaning. With --hosts: keys of
    another kind, for a run on several hosts."""
    if hosts is not None:
        if not part:
            fail("--hosts needs a folder to write into: hertzloop keys DIR --hosts ...", 2)
        write_keys(Path(part), hosts, days)
        return
    from hertzloop.controller.loading.law import LawError
    from hertzloop.scenes import keys as all_keys

    if markdown:
        print(all_keys.page(), end="")
        return
    try:
        found = all_keys.keys() if law is None else all_keys.keys_of(law)
    except LawError as error:
        fail(str(error), 2)
    chosen = [key for key in found if part in key.name]
    if part and not chosen:
        fail(f"no key contains '{part}'; `hertzloop keys` lists all", 2)
    table = Table("key", "takes", "means")
    for key in chosen:
        unit = f" ({key.unit})" if key.unit else ""
        default = key.default if key.default in ("", "needed") else f"default {key.default}"
        takes = all_keys.value_of(key) + unit + (default and f"; {default}")
        table.add_row(key.name, takes, key.meaning)
    out.print(table)


def _version(asked: bool) -> None:
    if asked:
        print(f"hertzloop {__version__}")
        raise typer.Exit()


def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which it is.")
    ] = False,
) -> None:
    pass


def register(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    app.callback()(_main)
    app.command()(scenes)
    app.command()(keys)


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


def register_modes(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(modes)
