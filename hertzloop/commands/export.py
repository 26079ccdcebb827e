"""The command that writes a recording for other tools."""

from pathlib import Path
from typing import Annotated

import typer

from hertzloop.commands.options import OverwriteOption, check_output
from hertzloop.commands.recordings import FileArgument, read_or_fail
from hertzloop.commands.terminal import err, fail, out
from hertzloop.extras import need


def export(
    file: FileArgument,
    out_file: Annotated[
        Path,
        typer.Option(
            "--out", "-o", help="File to write: .mcap, .parquet, .csv, .npz or .h5.", metavar="F"
        ),
    ],
    from_ms: Annotated[
        float, typer.Option("--from", min=0.0, help="From this simulated time on, ms.")
    ] = 0.0,
    to_ms: Annotated[
        float | None, typer.Option("--to", min=0.0, help="Up to this simulated time, ms.")
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Write a recording's samples for other tools: one MCAP message a sample for Foxglove and
    PlotJuggler, or Parquet, CSV, NPZ, HDF5 with units."""
    from hertzloop.views.labelled import export_labels
    from recordings.export import FORMATS, Samples
    from recordings.export import export as write
    from recordings.replay.data import scene_value
    from recordings.writer import RecordingError

    if out_file.suffix not in FORMATS:
        fail(f"{out_file} does not end in one of {', '.join(FORMATS)}, which say what to write", 2)
    if out_file.suffix == ".h5":
        need("h5py")
    if to_ms is not None and to_ms < from_ms:
        fail(f"--to {to_ms:g} is before --from {from_ms:g}", 2)
    check_output(out_file, overwrite, read=[file])
    recording = read_or_fail(file)
    for problem in recording.problems:
        err.print(f"{file}: {problem}", soft_wrap=True)
    samples = Samples(recording, export_labels(scene_value(recording, "sensors", "quantity", "xi")))
    if from_ms or to_ms is not None:
        last = samples.span_ns[1] if to_ms is None else round(to_ms * 1e6)
        samples = Samples(recording, samples.labels, (round(from_ms * 1e6), last))
    try:
        write(samples, out_file)
    except RecordingError as error:
        fail(str(error), 1)
    out.print(f"written: {out_file}", soft_wrap=True)
