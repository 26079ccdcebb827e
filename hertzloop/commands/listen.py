"""The command that lets a run be heard."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.table import Table

from hertzloop.commands.options import JsonOption, check_folder, make_folder, write_json
from hertzloop.commands.recordings import FileArgument, read_or_fail
from hertzloop.commands.terminal import err, fail, out

if TYPE_CHECKING:
    from hertzloop.results.impact_rows import Block
    from hertzloop.results.listening import Heard
    from hertzloop.scenes.scene import Scene
    from recordings.reader import Recording


_CHANGES = {
    "Sound exposure at the point": "exposure_pa2_s",
    "Sound energy through the half sphere": "sound_energy_j",
    "Sound energy until rest, by efficiencies": "until_rest_j",
}


def listen(
    file: FileArgument,
    folder: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for the sounds.", metavar="DIR")
    ],
    at: Annotated[
        tuple[float, float, float],
        typer.Option("--at", help="Listener: x, y from the plate's middle and height above, m."),
    ] = (0.0, 0.0, 1.0),
    slow: Annotated[
        float, typer.Option(min=1.0, max=1000.0, help="How many times slower than it was.")
    ] = 1.0,
    tail: Annotated[
        float, typer.Option(min=0.0, max=10.0, help="Ringing after the run's end, s.")
    ] = 0.3,
    energy: Annotated[
        bool, typer.Option("--energy", help="Also the sound energy through a half sphere.")
    ] = False,
    json_file: JsonOption = None,
) -> None:
    """Sound pressure of a run at a listener's point, with and without control, as WAV files on the
    same scale: the plate's modes in a rigid baffle, up to 20 kHz."""
    from hertzloop.commands.replaying import scene_of
    from hertzloop.scenes.scene import SceneError
    from recordings.writer import RecordingError

    if not at[2] > 0.0:
        fail(f"--at: the listener's height {at[2]:g} m is not above the plate", 2)
    check_folder(json_file)
    recording = read_or_fail(file, keep=True)
    for problem in recording.problems:
        err.print(f"{file}: {problem}", soft_wrap=True)
    make_folder(folder)
    try:
        data = heard_of(recording, scene_of(recording), folder, at, slow, tail, energy)
    except (RecordingError, SceneError) as error:
        fail(str(error), 1)
    except OSError as error:
        fail(f"cannot write into {folder}: {error.strerror}", 1)
    _show(data)
    write_json(json_file, data)


def heard_of(
    recording: "Recording",
    scene: "Scene",
    folder: Path,
    at: tuple[float, float, float],
    slow: float,
    tail_s: float,
    energy: bool = False,
) -> dict[str, Any]:
    """Write the sounds; what was heard. Raises RecordingError, SceneError, OSError."""
    from hertzloop.loop.compiled import uncontrolled_rows
    from hertzloop.results import listening
    from hertzloop.results.figures import pieces_of

    grid = listening.grid_of(scene, tail_s, slow)
    size = scene.plate.size_m or (0.0, 0.0)
    place = np.array([0.5 * size[0] + at[0], 0.5 * size[1] + at[1], at[2]])
    recorded = pieces_of(recording)
    runs: dict[str, Iterable[Block]] = {"without-control": recorded}
    if scene.controller.law != "off":
        free = uncontrolled_rows(scene.without_control())
        runs = {"with-control": recorded, "without-control": free}
    heard: dict[Path, Heard] = {}
    data: dict[str, Any] = {"at_m": list(at), "slow": slow, "tail_s": tail_s, "runs": {}}
    for name, blocks in runs.items():
        path = folder / f"{recording.path.stem}-{name}.wav"
        kept = list(blocks) if energy else []
        drive = listening.drive_of(scene, kept or blocks)
        heard[path] = listening.listen(scene, drive, place, grid)
        data["runs"][name] = {
            "file": str(path),
            "peak_pa": heard[path].peak_pa,
            "exposure_pa2_s": heard[path].exposure_pa2_s,
            "level_db": _level(heard[path].exposure_pa2_s),
        }
        if energy:
            rows = np.concatenate([rows for _, rows in kept], axis=1)
            data["runs"][name] |= {
                "sound_energy_j": listening.radiated_energy_j(scene, drive, grid),
                "until_rest_j": listening.until_rest_j(scene, rows),
            }
    data["full_scale_pa"] = listening.write_wavs(heard)
    return data


def _level(exposure_pa2_s: float) -> float:
    """Sound exposure level, dB re (20 uPa)^2 1 s."""
    return 10.0 * math.log10(exposure_pa2_s / 4e-10) if exposure_pa2_s > 0.0 else -math.inf


def _show(data: dict[str, Any]) -> None:
    runs = data["runs"]
    table = Table(title="Sound at the listener's point", title_justify="left")
    for heading in ("", *(name.replace("-", " ") for name in runs)):
        table.add_column(heading, justify="right")
    for label, key, factor, unit in (
        ("largest pressure", "peak_pa", 1.0, "Pa"),
        ("sound exposure level", "level_db", 1.0, "dB"),
        ("sound energy, half sphere", "sound_energy_j", 1e6, "uJ"),
        ("sound energy until rest, by efficiencies", "until_rest_j", 1e6, "uJ"),
    ):
        if all(key in run for run in runs.values()):
            table.add_row(label, *(f"{factor * run[key]:.3g} {unit}" for run in runs.values()))
    out.print(table)
    if data["full_scale_pa"] == 0.0:
        out.print("Silence: nothing moves the plate.")
    elif len(runs) == 2:
        for label, key in _CHANGES.items():
            both = [run.get(key, 0.0) for run in runs.values()]
            if min(both) > 0.0:
                change = 10.0 * math.log10(both[0] / both[1])
                out.print(f"{label}: with control {change:+.2f} dB against without")
    for run in runs.values():
        out.print(f"written: {run['file']}", soft_wrap=True)
