"""Commands that export a recording or the plant for other tools."""

import math
import os
import platform
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.terminal import err, fail, out, say_problems
from hertzloop.interop.object_code import outline
from hertzloop.recordings.reader import read
from hertzloop.views.labels import export_labels


def export(
    file: options.FileArgument,
    out_file: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="F", help="Write this .mcap, .parquet or .csv file."),
    ],
    from_ms: Annotated[
        float, typer.Option("--from", min=0, help="Start at this simulated time, ms.")
    ] = 0.0,
    to_ms: Annotated[
        float | None, typer.Option("--to", min=0, help="Stop at this simulated time, ms.")
    ] = None,
    overwrite: options.OverwriteOption = False,
) -> None:
    """Write a recording's samples as CSV, Parquet or MCAP.

    Rerun, Foxglove and PlotJuggler draw the .mcap file as curves. Beside F.csv, F-columns.csv has
    the unit and the meaning of each column.
    """
    # Arrow takes 0.05 s, which the other command saves.
    from hertzloop.recordings.export import export as sample_export
    from hertzloop.recordings.export.samples import Samples

    if out_file.suffix not in sample_export.FORMATS:
        endings = ", ".join(sample_export.FORMATS)
        fail(f"--out = {out_file}: unknown format. Use a name that ends in {endings}.")
    for option, value in (("--from", from_ms), ("--to", to_ms)):
        if value is not None and not math.isfinite(value):
            fail(f"{option} = {value:g}: must be a finite number. Give a time in ms.")
    if to_ms is not None and to_ms < from_ms:
        fail(f"--to = {to_ms:g}: is before --from = {from_ms:g}. Give a later time.")
    written = sample_export.outputs(out_file)
    for path in written:
        outputs.check_output(path, overwrite, read=[file])
    recording = read(file)
    say_problems(recording)
    samples = Samples(recording, export_labels(recording.scene_value("sensors", "quantity", "xi")))
    if from_ms or to_ms is not None:
        last = samples.span_ns[1] if to_ms is None else round(to_ms * 1e6)
        samples = Samples(recording, samples.labels, (round(from_ms * 1e6), last))
    if not samples.end_step:
        fail(f"{file}: has no samples that can be read. Give another recording.")
    if next(samples.windows(), None) is None:
        end_ms = (samples.end_step - 1) * samples.step_ns / 1e6
        given = f"--from = {from_ms:g}" + ("" if to_ms is None else f", --to = {to_ms:g}")
        fail(f"{given}: has no samples. Give a span within 0 to {end_ms:.10g} ms.")
    sample_export.export(samples, out_file)
    out.say(f"written: {' and '.join(map(str, written))}")


CpuOption = Annotated[
    Literal["host", "x86-64", "x86-64-v2", "x86-64-v3", "x86-64-v4"],
    typer.Option(
        help="Compile for this processor; host: the same bytes as runs on this processor."
    ),
]


def export_plant(
    scene: options.SceneArgument,
    out_file: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="F", help="Write this .fmu or .so file.")
    ] = None,
    out_dir: Annotated[
        Path | None,
        typer.Option(
            "--out-dir",
            metavar="DIR",
            help="Write the C library, its header and an example into this folder.",
        ),
    ] = None,
    cpu: CpuOption = "x86-64-v3",
    fmi: Annotated[Literal["2", "3"], typer.Option(help="Use this version of FMI for .fmu.")] = "3",
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    overwrite: options.OverwriteOption = False,
) -> None:
    """Write the plant for other programs: an FMU or a C library.

    It holds plant, actuator and sensor. The calling program gives the force.
    """
    here = sys.platform, platform.machine()
    if here != ("linux", "x86_64"):
        fail(f"a plant is exported on Linux on x86-64, not on {' '.join(here)}")
    out_path, folder = _target(out_file, out_dir, overwrite), out_dir is not None
    resolved = prepare.scene_from(scene, settings, seed)
    if not folder:
        inputs = outputs.files_of(resolved, scene, *(settings or []))
        outputs.check_output(out_path, overwrite, read=inputs)
    from hertzloop.interop import fmu as library
    from hertzloop.interop.image import image
    from hertzloop.interop.objects import is_compiled

    made = image(resolved)
    if not is_compiled(outline(made.unit), cpu):
        err.print(f"Compiling the kernels for {cpu}: once, about half a minute.")
    outputs.make_folder(out_path if folder else out_path.parent)
    if folder:
        library.write_folder(made, cpu, out_path)
    elif out_path.suffix == ".fmu":
        library.write_fmu(made, cpu, fmi, out_path)
    else:
        library.write_library(made, cpu, out_path)
    if resolved.scene.run.plate_model == "auto" and resolved.plate_model == "infinite":
        err.say(
            "the plate is infinite, as in this scene's runs, for the force of its own law; for any "
            "force take --set run.plate_model=modal"
        )
    arrays = len(made.data) / 1000
    out.say(f"written: {out_path}, for {cpu}, {arrays:z.0f} kB of it arrays")


def _target(out_file: Path | None, out_dir: Path | None, overwrite: bool) -> Path:
    """Return the file or the folder to write; end the command unless there is one of them."""
    if out_file is not None and out_dir is not None:
        fail(f"--out = {out_file}: cannot be combined with --out-dir. Remove one of the two.")
    if out_file is None and out_dir is None:
        fail("no output is given. Give --out F for a file, or --out-dir DIR for a folder.")
    if out_file is not None and out_file.suffix not in (".fmu", ".so"):
        fail(f"--out {out_file}: must end in .fmu or .so. For a folder, give --out-dir")
    if out_dir is not None and os.path.isdir(out_dir) and any(out_dir.iterdir()) and not overwrite:
        fail(f"--out-dir = {out_dir}: the folder is not empty. Choose another, or add --overwrite.")
    path = out_file or out_dir
    assert path is not None
    return path
