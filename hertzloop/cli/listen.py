"""The command `listen`."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from hertzloop.cli import options, outputs
from hertzloop.cli.terminal import fail, out, say_problems
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.listening import write_sounds
from hertzloop.results.recorded import setup_of
from hertzloop.scene.errors import SceneError
from hertzloop.views.format import Table


def listen(
    file: options.FileArgument,
    folder: Annotated[
        Path,
        typer.Option(
            "--out-dir",
            "-o",
            metavar="DIR",
            help="Write the sounds into this folder; default: the working folder.",
        ),
    ] = Path(),
    distance: Annotated[
        float, typer.Option(min=0.01, max=1000, help="Listen at this distance on the axis, m.")
    ] = 1.0,
    slow: Annotated[
        float, typer.Option(min=1, max=1000, help="Slow the sound down by this factor.")
    ] = 1.0,
    tail: Annotated[
        float,
        typer.Option(min=0, max=10, help="Let the plate ring for this time after the run, s."),
    ] = 0.3,
    json_file: options.JsonOption = None,
) -> None:
    """Write the sound of a run, with and without control, as WAV.

    It is the sound pressure on the axis of the plate in a rigid baffle, by the volume of air that
    its modes move, up to 20 kHz. All files have the same scale.
    """
    outputs.check_json(json_file)
    recording = read(file)
    say_problems(recording)
    outputs.make_folder(folder)
    try:
        data = write_sounds(recording, setup_of(recording), folder, distance, slow, tail)
    except (RecordingError, SceneError) as error:
        fail(str(error), 1)
    _print_sounds(data)
    outputs.write_json(json_file, data)


def _print_sounds(data: dict[str, Any]) -> None:
    """Print pressure and level of each sound."""
    runs = data["runs"]
    compared = len(runs) == 2 and data["full_scale_pa"] > 0.0
    title = f"Sound on the axis, {data['distance_m']:g} m from the plate"
    right = ["", *(name.replace("-", " ") for name in runs), *["change"] * compared]
    table = Table(right=right, title=title)
    for label, key, unit in (
        ("largest pressure", "peak_pa", "Pa"),
        ("sound exposure level", "level_db", "dB"),
    ):
        values = [run[key] for run in runs.values()]
        words = [f"{value:.3g} {unit}" for value in values]
        table.add_row(label, *words, *([_change(values, unit)] if compared else []))
    out.print(table)
    if data["full_scale_pa"] == 0.0:
        out.print("Silence: no force moves the plate.")
    for run in runs.values():
        out.say(f"written: {run['file']}")


def _change(values: list[float], unit: str) -> str:
    """Return the change from the second value to the first, in dB; empty without one."""
    first, second = values
    if unit == "dB":
        return f"{first - second:+z.2f} dB" if min(values) > -math.inf else ""
    return f"{20.0 * math.log10(first / second):+z.2f} dB" if min(values) > 0.0 else ""
