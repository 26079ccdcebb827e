"""The command `listen`."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from hertzloop.cli import options, outputs
from hertzloop.cli.terminal import fail, out, say_problems
from hertzloop.plant.metrics.sound import DIRECTIONS
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.listening import write_sounds
from hertzloop.scene.errors import SceneError
from hertzloop.views.format import Table
from hertzloop.views.replaying import scene_of

_ENERGIES = {
    "sound_energy_j": "sound energy, half sphere",
    "by_modes_j": "... by each mode's own efficiency",
    "by_means_j": "... by mean efficiencies",
    "until_rest_j": "... by these until the plate is at rest",
}


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
    at: Annotated[
        tuple[float, float, float],
        typer.Option(help="Place the listener at x, y from the plate centre and this height, m."),
    ] = (0.0, 0.0, 1.0),
    slow: Annotated[
        float, typer.Option(min=1.0, max=1000.0, help="Slow the sound down by this factor.")
    ] = 1.0,
    tail: Annotated[
        float,
        typer.Option(min=0.0, max=10.0, help="Let the plate ring for this time after the run, s."),
    ] = 0.3,
    energy: Annotated[
        bool, typer.Option("--energy", help="Compute the sound energy through a half sphere.")
    ] = False,
    json_file: options.JsonOption = None,
) -> None:
    """Write the sound of a run, with and without control, as WAV.

    It is the sound pressure at a listener's point, from the plate's modes in a rigid baffle, up to
    20 kHz. All files have the same scale.
    """
    if not at[2] > 0.0:
        fail(f"--at = {at[2]:g} m: the listener is not above the plate. Give a positive height.")
    outputs.check_json(json_file)
    recording = read(file, keep=True)
    say_problems(recording)
    outputs.make_folder(folder)
    try:
        data = write_sounds(recording, scene_of(recording), folder, at, slow, tail, energy)
    except (RecordingError, SceneError) as error:
        fail(str(error), 1)
    _print_sounds(data)
    outputs.write_json(json_file, data)


def _print_sounds(data: dict[str, Any]) -> None:
    """Print pressure, level and energies of each sound."""
    runs = data["runs"]
    compared = len(runs) == 2 and data["full_scale_pa"] > 0.0
    right = ["", *(name.replace("-", " ") for name in runs), *["change"] * compared]
    table = Table(right=right, title="Sound at the listener's point")
    for label, key, factor, unit in (
        ("largest pressure", "peak_pa", 1.0, "Pa"),
        ("sound exposure level", "level_db", 1.0, "dB"),
        *((label, key, 1e6, "uJ") for key, label in _ENERGIES.items()),
    ):
        if all(key in run for run in runs.values()):
            values = [run[key] for run in runs.values()]
            words = [f"{factor * value:.3g} {unit}" for value in values]
            table.add_row(label, *words, *([_change(values, unit)] if compared else []))
    out.print(table)
    if data["full_scale_pa"] == 0.0:
        out.print("Silence: no force moves the plate.")
    for name, run in runs.items():
        _explain(name.replace("-", " "), run)
    for run in runs.values():
        out.say(f"written: {run['file']}")


def _change(values: list[float], unit: str) -> str:
    """Return the change from the second value to the first, in dB; empty without one."""
    first, second = values
    if unit == "dB":
        return f"{first - second:+z.2f} dB" if min(values) > -math.inf else ""
    times = 20.0 if unit == "Pa" else 10.0
    return f"{times * math.log10(first / second):+z.2f} dB" if min(values) > 0.0 else ""


def _explain(name: str, run: dict[str, Any]) -> None:
    """Print by how much the sound energies of a run differ, and why."""
    energies = [run.get(key, 0.0) for key in _ENERGIES]
    if min(energies) > 0.0:
        levels = [10.0 * math.log10(one) for one in energies]
        through, means, later = (levels[i] - levels[j] for i, j in ((0, 1), (2, 1), (3, 2)))
        out.say(
            f"{name}: the half sphere, by {DIRECTIONS} directions, has {through:+z.2f} dB against "
            f"the modes' own efficiencies, mean efficiencies {means:+z.2f} dB; what follows after "
            f"the file (--tail) adds {later:z.2f} dB"
        )
