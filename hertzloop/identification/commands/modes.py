"""The command `scene modes`: modes of a scene's plate, or measured ones, as a file of modes."""

import math
import shlex
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tomli_w
import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.scene import scene_name
from hertzloop.cli.terminal import fail, out, progress
from hertzloop.common.atomic_files import write_whole
from hertzloop.common.optional_dependencies import need
from hertzloop.identification.modes import universal as uff
from hertzloop.identification.modes.hits import read_hits
from hertzloop.identification.modes.modes import (
    MeasuredModes,
    Tell,
    modes_of_hits,
    modes_of_responses,
)
from hertzloop.identification.modes.responses import responses_of_sets
from hertzloop.plant.structures.mode_file import SUFFIXES, ModeTable, write_modes
from hertzloop.results.deflection import modes_of_scene
from hertzloop.scene import model_error
from hertzloop.scene.build import check_modes_reach_impact
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT, shipped, with_modes_file
from hertzloop.scene.setup import Setup, load
from hertzloop.views.format import Table

# Settings with which any modes can be simulated: nothing stands for those beyond.
_COMPLETE = ("plate.tail=spring", "plate.residual_flexibility_m_n=0")

if TYPE_CHECKING:
    from hertzloop.identification.modes.universal import FileUnits, Points, UniversalModes


def modes(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SCENE] [FILE]...",
            help="Name of a shipped scene, or a .toml file; more files of --from.",
        ),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="FILE",
            help="Read measured modes or frequency responses (UFF, UNV), or records of hits.",
        ),
    ] = None,
    contact: Annotated[
        str | None,
        typer.Option(metavar="NODE", help="Node of the contact point; of records, a name."),
    ] = None,
    actuator: Annotated[
        str | None,
        typer.Option(metavar="NODE", help="Node of the actuator; default: the contact point."),
    ] = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            metavar="NODE",
            help="Node of the sensor; of records, a name of its place; default: the contact point.",
        ),
    ] = None,
    direction: Annotated[
        Literal["x", "y", "z"] | None,
        typer.Option(help="Direction of force and motion; default: the only one of the file."),
    ] = None,
    reference: Annotated[
        int | None, typer.Option(metavar="NODE", help="Node of the force of frequency responses.")
    ] = None,
    kind: Annotated[
        Literal["modes", "receptance", "mobility", "accelerance"] | None,
        typer.Option(help="What to take of a file that holds several, or does not say."),
    ] = None,
    units: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH,FORCE",
            help="Units of the file, such as mm,N; default: those that the file states.",
        ),
    ] = None,
    unit_mass: Annotated[
        bool,
        typer.Option("--unit-modal-mass", help="Take the shapes of the file as mass-normalised."),
    ] = False,
    loss_factor: Annotated[
        float | None,
        typer.Option(min=0.0, max=1.0, help="Loss factor of every mode of a file without damping."),
    ] = None,
    exponential_window: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS", help="Time constant of the exponential window of records of hits, s."
        ),
    ] = None,
    hold_out: Annotated[
        list[Path] | None,
        typer.Option(help="Predict this measurement; default: each hit in turn, every fifth line."),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw measured and modelled response to this file.")
    ] = None,
    out_file: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write this .csv, .parquet or .npz file.")
    ] = None,
    settings: options.SetOption = None,
    grid: Annotated[
        bool, typer.Option("--grid", help="Add mode shapes on a grid for the replay; .npz only.")
    ] = False,
    json_file: options.JsonOption = None,
    overwrite: options.OverwriteOption = False,
) -> None:
    """Write modes as a table that a scene can read: of a plate, or measured ones.

    The key plate.modes of a scene takes this file. With --from, a scene with these modes in the
    place of the plate of SCENE is written beside it.
    """
    scene, files = _scene_and_files(names or [], source)
    if source is None:
        given = {
            "contact": contact,
            "actuator": actuator,
            "sensor": sensor,
            "units": units,
            "direction": direction,
            "loss-factor": loss_factor,
            "reference": reference,
            "unit-modal-mass": unit_mass or None,
            "kind": kind,
            "picture": picture,
            "hold-out": hold_out,
            "exponential-window": exponential_window,
        }
        for option, value in given.items():
            if value is not None:
                fail(f"--{option}: describes a measured structure. Add --from FILE.")
        _of_scene(scene, out_file, settings or [], grid, overwrite, json_file)
        return
    if grid:
        fail("--grid: measured modes have no shapes on a grid. Leave it out.")
    target = _target(out_file or Path(f"{Path(source).stem}-modes.csv"))
    beside = target.with_suffix(".toml")
    held = hold_out or []
    for path in (target, beside):
        outputs.check_output(path, overwrite, read=[*map(Path, files), *held, Path(scene)])
    if picture is not None:
        outputs.check_picture(picture)
        outputs.check_output(
            picture, overwrite, "--picture", [*map(Path, files), *held, Path(scene)]
        )
    outputs.check_json(json_file, target, beside, picture)
    paths = list(map(Path, files))
    if contact is None:
        fail(_missing_contact(paths[0], kind, units))
    if exponential_window is not None and not 0.0 < exponential_window < math.inf:
        fail(
            f"--exponential-window = {exponential_window:g}: must be positive. Give the time "
            "constant in seconds."
        )
    told: dict[str, Any] = {}
    if paths[0].suffix.lower() in uff.SUFFIXES:
        if exponential_window is not None:
            fail("--exponential-window: is for records of hits. Remove the option.")
        if len(paths) != 1:
            fail(f"--from: {len(files)} files are given. Give one universal file.")
        points = uff.Points(
            uff.node_of("contact", contact),
            None if actuator is None else uff.node_of("actuator", actuator),
            None if sensor is None else uff.node_of("sensor", sensor),
            direction,
        )
        need("pyuff")
        sets = uff.read_sets(paths[0])
        in_units = uff.units_of(sets, paths[0], units)
        from_modes = uff.holds_modes(sets, kind, paths[0])
        if from_modes:
            table = _of_modes(
                uff.modes_of_sets(
                    sets, paths[0], points, in_units, unit_mass=unit_mass, loss_factor=loss_factor
                ),
                told,
            )
        else:
            found = _of_responses(paths[0], sets, points, in_units, kind, reference, held, units)
    else:
        from_modes = False
        for option, value in {
            "actuator": actuator,
            "direction": direction,
            "kind": kind,
            "reference": reference,
            "units": units,
        }.items():
            if value is not None:
                fail(f"--{option}: records do not have it. Remove the option.")
        found = _of_hits(paths, held, sensor in (None, contact), exponential_window)
    if not from_modes:
        table = found.table
        _tell_check(found, told)
    elif held or picture is not None:
        fail("--hold-out, --picture: modes have no measured response. Remove the option.")
    setup, warning = _write(table, target, scene, settings or [])
    found_modes = (
        f"{len(table.omega_rad_s)} modes from {_hz(table, 0):.5g} to {_hz(table, -1):.5g} Hz."
    )
    expected = None
    if warning:
        out.say(f"{found_modes} The scene cannot be run yet: {warning}.")
    else:
        expected = model_error.expected_error(setup)
        out.say(
            f"{found_modes} Expected error of the first impact in this scene: "
            f"{100 * expected:.2g} %."
        )
    base, then = _named(scene, settings or []), shlex.join(["hertzloop", "run", str(beside)])
    out.say(
        f"written: {target} and {beside}, which has striker, material of the plate "
        f"({setup.plate_material or 'own numbers'}) and law of {base}."
        + ("" if warning else f" Next: {then}")
    )
    if picture is not None:
        from hertzloop.identification.modes.picture import draw  # of an extra

        draw(found, picture)
        out.print(f"written: {picture}")
    told |= {
        "modes": len(table.omega_rad_s),
        "lowest_hz": _hz(table, 0),
        "highest_hz": _hz(table, -1),
        "residual_flexibility_m_n": table.residual_flexibility_m_n,
        "expected_error": expected,
        "warning": warning or None,
        "files": [str(target), str(beside)],
    }
    outputs.write_json(json_file, told)


def _of_modes(found: "UniversalModes", told: dict[str, Any]) -> ModeTable:
    """The modes of a file, and what is to be said of them."""
    out.print(f"Direction {found.direction}, units of the file: {found.units.name}.")
    if found.most_complex:
        out.say(
            "The shapes are complex. The imaginary part of the nearest real shapes is at most "
            f"{100 * found.most_complex:.2g} % of the largest value."
        )
    if found.undamped:
        out.print("The file has no damping. Give --loss-factor to set it.")
    told |= {
        "direction": found.direction,
        "units": found.units.name,
        "largest_imaginary_part": found.most_complex,
        "undamped": found.undamped,
    }
    return found.table


def _of_responses(
    path: Path,
    sets: list[dict[str, Any]],
    points: "Points",
    in_units: "FileUnits | None",
    kind: str | None,
    reference: int | None,
    held: list[Path],
    units: str | None,
) -> MeasuredModes:
    if len(held) > 1:
        fail(f"--hold-out: {len(held)} files are given. Give one universal file.")
    responses = responses_of_sets(sets, path, points, in_units, kind, reference)
    other = None
    for one in held:
        others = uff.read_sets(one, "--hold-out")
        other = responses_of_sets(
            others, one, points, uff.units_of(others, one, units), kind, reference
        )
    out.say(
        f"{responses.kind.capitalize()} of the nodes {', '.join(map(str, responses.nodes))} to a "
        f"force at {responses.reference}, direction {responses.direction}, "
        f"{responses.hz[0]:.5g} to {responses.hz[-1]:.5g} Hz."
    )
    with _progress() as tell:
        return modes_of_responses(responses, other, points, tell)


def _of_hits(
    paths: list[Path], held: list[Path], at_contact: bool, window_s: float | None
) -> MeasuredModes:
    hits, predicted = (
        [replace(hit, window_s=window_s) for hit in some]
        for some in (read_hits(paths), read_hits(held, "--hold-out") if held else [])
    )
    with _progress() as tell:
        return modes_of_hits(hits, predicted, at_contact, tell)


@contextmanager
def _progress() -> Iterator[Tell]:
    with progress("modes", 1, lines=True) as advance:
        yield lambda name, count, error: advance(
            0, f"{name} held out: {count} modes, error {error:.3g}"
        )


def _tell_check(found: MeasuredModes, told: dict[str, Any]) -> None:
    table = Table("held out", "modes", "error / rms, %", "largest error / peak, %")
    for one in found.held_out:
        table.add_row(one.name, str(one.modes), f"{100 * one.rms:.2f}", f"{100 * one.peak:.2f}")
    out.print(table)
    for note in found.notes:
        out.say(note)
    if found.delay_s:
        told["delay_s"] = found.delay_s
    told["held_out"] = [
        {"name": one.name, "modes": one.modes, "error": one.rms, "largest_error": one.peak}
        for one in found.held_out
    ]


def _target(path: Path) -> Path:
    """The file to write; ends the command for one of another format."""
    if path.suffix not in SUFFIXES:
        fail(f"--out = {path}: unknown format. Use a name that ends in {', '.join(SUFFIXES)}.")
    return path


def _hz(table: ModeTable, mode: int) -> float:
    return float(table.omega_rad_s[mode] / (2 * np.pi))


def _scene_and_files(names: list[str], source: str | None) -> tuple[str, list[str]]:
    """The scene, and the files of --from: shells write the files of a pattern one by one."""
    scenes = [name for name in names if name in shipped() or name.endswith(".toml")]
    files = [name for name in names if name not in scenes]
    if source is None:
        scenes, files = [*scenes, *files], []
    if len(scenes) > 1:
        fail(f"SCENE = {', '.join(scenes)}: is more than one scene. Give one.")
    return scenes[0] if scenes else DEFAULT, [source, *files] if source is not None else []


def _named(scene: str, settings: list[str]) -> str:
    """A scene with what --set changed, on one line."""
    changed = ", ".join(" ".join(one.split()) for one in settings)
    return f"{scene} with {changed}" if changed else scene


def _missing_contact(path: Path, kind: str | None, units: str | None) -> str:
    """What is missing beside --contact, in one sentence each."""
    missing = ["--contact: is missing. Give the node of the contact point; of records, a name."]
    if path.suffix.lower() in uff.SUFFIXES and path.is_file():
        need("pyuff")
        sets = uff.read_sets(path)
        in_units = uff.units_of(sets, path, units)
        if uff.holds_modes(sets, kind, path) and in_units is None:
            missing.append(uff.no_units(path))
    return " ".join(missing)


def _write(table: ModeTable, target: Path, scene: str, settings: list[str]) -> tuple[Setup, str]:
    """Write a file of modes, and a scene with them beside it. Returns the scene, and why modes that
    end too low for its striker, or have no residual flexibility, cannot be simulated in it."""
    content = write_modes(target.suffix, table)
    data = with_modes_file(scene, settings, target.name, scene_name(target))
    base = _named(scene, settings)
    data["shows"] = f"Modes measured, in {target.name}; striker and law of {base}"
    text = f"# Modes by hertzloop scene modes; all else from {base}.\n{tomli_w.dumps(data)}"
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / target.name).write_bytes(content)
        trial = Path(folder) / target.with_suffix(".toml").name
        trial.write_text(text, encoding="utf-8")
        warning = ""
        try:
            setup = load(str(trial))
            check_modes_reach_impact(setup.plant)
        except SceneError as error:
            warning = str(error).rstrip(".")
            setup = load(str(trial), _COMPLETE)  # all else has to be right
    write_whole(target, content)
    write_whole(target.with_suffix(".toml"), text)
    return setup, warning


def _of_scene(
    scene: str,
    out_file: Path | None,
    settings: list[str],
    grid: bool,
    overwrite: bool,
    json_file: Path | None,
) -> None:
    resolved = prepare.scene_from(scene, settings, None)
    target = _target(out_file or Path(f"{resolved.name}-modes.csv"))
    if grid and target.suffix != ".npz":
        fail(f"--out = {target}: cannot hold shapes on a grid. Use an .npz file with --grid.")
    outputs.check_output(target, overwrite, read=outputs.files_of(resolved, scene, *settings))
    outputs.check_json(json_file, target)

    table = modes_of_scene(resolved, grid)
    write_whole(target, write_modes(target.suffix, table))
    out.say(
        f"{len(table.omega_rad_s)} modes up to {_hz(table, -1):.4g} Hz (modes "
        "of equal frequency merged, modes without participation dropped), and a residual "
        f"flexibility of {table.residual_flexibility_m_n:.4g} m/N; written: {target}"
    )
    outputs.write_json(
        json_file,
        {
            "modes": len(table.omega_rad_s),
            "highest_hz": _hz(table, -1),
            "residual_flexibility_m_n": table.residual_flexibility_m_n,
            "files": [str(target)],
        },
    )
