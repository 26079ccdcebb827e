"""The command that writes a scene's plant for programs without Python."""

import os
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from hertzloop.commands.options import (
    OverwriteOption,
    SceneArgument,
    SeedOption,
    SetOption,
    check_output,
    check_reachable,
    check_writable,
    files_of,
    make_folder,
    scene_from,
)
from hertzloop.commands.terminal import err, fail, out
from hertzloop.scenes.errors import SceneError

CpuOption = Annotated[
    Literal["host", "x86-64", "x86-64-v2", "x86-64-v3", "x86-64-v4"],
    typer.Option(help="Processor that will run it; host: the bytes of the runs on this one."),
]


def export_plant(
    scene: SceneArgument,
    out_path: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="F",
            help="plant.fmu, plant.so, or a folder: library, header, example.",
        ),
    ],
    cpu: CpuOption = "x86-64-v3",
    fmi: Annotated[Literal["2", "3"], typer.Option(help="Version of FMI for .fmu.")] = "3",
    seed: SeedOption = None,
    settings: SetOption = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Write plant, actuator and sensor of a scene for programs without Python: as a unit for
    co-simulation (FMU), or a C library.

    The controller stays behind: whoever calls the plant gives the force.
    """
    if (sys.platform, _machine()) != ("linux", "x86_64"):
        fail(f"a plant is exported on Linux on x86-64, not on {sys.platform} {_machine()}", 2)
    folder = out_path.suffix == ""
    if not folder and out_path.suffix not in (".fmu", ".so"):
        fail(f"{out_path} does not end in .fmu or .so, nor in nothing, for a folder", 2)
    check_reachable(out_path)
    resolved = scene_from(scene, settings, seed)
    if not folder:
        check_output(out_path, overwrite, read=files_of(resolved, scene, *(settings or [])))
    elif os.path.isdir(out_path) and any(out_path.iterdir()) and not overwrite:
        fail(f"the folder {out_path} is not empty; choose another, or allow it with --overwrite", 2)
    from hertzloop.interop import library
    from hertzloop.interop.fmu import write_fmu
    from hertzloop.interop.image import image
    from hertzloop.interop.objects import CompileFault, is_compiled
    from jit.object_code import outline

    try:
        made = image(resolved)
    except SceneError as error:
        fail(str(error), 2)
    if not is_compiled(outline(made.unit), cpu):
        err.print(f"Compiling the kernels for {cpu}: once, about half a minute.")
    if folder:
        make_folder(out_path)
    else:
        check_writable(out_path.parent)
    try:
        if folder:
            library.write_folder(made, cpu, out_path)
        elif out_path.suffix == ".fmu":
            write_fmu(made, cpu, fmi, out_path)
        else:
            library.write_library(made, cpu, out_path)
    except (SceneError, library.NoCompiler) as error:
        fail(str(error), 2)
    except CompileFault as error:
        fail(str(error), 1)
    if resolved.plate_model_asked == "auto" and resolved.plate_model == "infinite":
        err.print(
            "the plate is infinite, as in this scene's runs, for the force of its own law; for any "
            "force take --set run.plate_model=modal",
            soft_wrap=True,
        )
    arrays = len(made.data) / 1000
    out.print(f"written: {out_path}, for {cpu}, {arrays:.0f} kB of it arrays", soft_wrap=True)


def _machine() -> str:
    import platform

    return platform.machine()
