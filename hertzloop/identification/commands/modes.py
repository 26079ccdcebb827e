"""The command `scene modes`: modes of a scene's plate, or measured ones, as a file of modes."""

import math
import shlex
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tomli_w
import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.scene import scene_name
from hertzloop.cli.terminal import fail, out, progress
from hertzloop.common.atomic_files import atomic_write
from hertzloop.common.optional_dependencies import need
from hertzloop.identification.modes import universal
from hertzloop.identification.modes.hits import read_hits
from hertzloop.identification.modes.modes import (
    MeasuredModes,
    ModesCallback,
    modes_of_hits,
    modes_of_responses,
)
from hertzloop.identification.modes.responses import FrequencyResponses, responses_of_sets
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
    from hertzloop.identification.modes.universal import Points, UniversalModes


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
    measured = _MeasuredOptions(
        contact=contact,
        actuator=actuator,
        sensor=sensor,
        units=units,
        direction=direction,
        loss_factor=loss_factor,
        reference=reference,
        unit_modal_mass=unit_mass or None,
        kind=kind,
        picture=picture,
        hold_out=hold_out,
        exponential_window=exponential_window,
    )
    if source is None:
        for option in measured.given():
            fail(f"--{option}: describes a measured structure. Add --from FILE.")
        _write_scene_modes(scene, out_file, settings or [], grid, overwrite, json_file)
        return
    if grid:
        fail("--grid: measured modes have no shapes on a grid. Leave it out.")
    target = _target(out_file or Path(f"{Path(source).stem}-modes.csv"))
    beside, paths = target.with_suffix(".toml"), list(map(Path, files))
    read = [*paths, *measured.held, Path(scene)]
    for path in (target, beside):
        outputs.check_output(path, overwrite, read=read)
    if picture is not None:
        outputs.check_picture(picture)
        outputs.check_output(picture, overwrite, "--picture", read)
    outputs.check_json(json_file, target, beside, picture)
    data: dict[str, Any] = {}
    table, found = _read_measured_modes(paths, measured, data)
    setup, warning = _write(table, target, scene, settings or [])
    expected = _say_written(
        table, setup, warning, target, _scene_and_settings(scene, settings or [])
    )
    if picture is not None and found is not None:
        from hertzloop.identification.modes.picture import draw  # of an extra

        draw(found, picture)
        out.print(f"written: {picture}")
    data |= {
        "modes": len(table.omega_rad_s),
        "lowest_hz": _hz(table, 0),
        "highest_hz": _hz(table, -1),
        "residual_flexibility_m_n": table.residual_flexibility_m_n,
        "expected_error": expected,
        "warning": warning or None,
        "files": [str(target), str(beside)],
    }
    outputs.write_json(json_file, data)


@dataclass(frozen=True)
class _MeasuredOptions:
    """Options that describe a measured structure, by their names on the command line."""

    contact: str | None
    actuator: str | None
    sensor: str | None
    units: str | None
    direction: Literal["x", "y", "z"] | None
    loss_factor: float | None
    reference: int | None
    unit_modal_mass: bool | None
    kind: str | None
    picture: Path | None
    hold_out: list[Path] | None
    exponential_window: float | None

    def given(self) -> dict[str, Any]:
        """Return the options that were given, by their names."""
        every = {name.replace("_", "-"): value for name, value in asdict(self).items()}
        return {name: value for name, value in every.items() if value is not None}

    @property
    def held(self) -> list[Path]:
        """Files of measurements that are only predicted."""
        return self.hold_out or []


def _read_measured_modes(
    paths: list[Path], measured: _MeasuredOptions, data: dict[str, Any]
) -> tuple[ModeTable, MeasuredModes | None]:
    """Return the modes of files, and their check, None if the file holds modes itself. What is said
    of them is added to `data`."""
    window_s = measured.exponential_window
    if measured.contact is None:
        fail(_missing_contact(paths[0], measured.kind, measured.units))
    if window_s is not None and not 0.0 < window_s < math.inf:
        fail(
            f"--exponential-window = {window_s:g}: must be positive. Give the time "
            "constant in seconds."
        )
    if paths[0].suffix.lower() in universal.SUFFIXES:
        table, found = _read_universal_file(paths, measured, data)
    else:
        given = measured.given()
        for option in ("actuator", "direction", "kind", "reference", "units"):
            if option in given:
                fail(f"--{option}: records do not have it. Remove the option.")
        at_contact = measured.sensor in (None, measured.contact)
        found = _modes_from_hits(paths, measured.held, at_contact, window_s)
        table = found.table
    if found is not None:
        _say_check(found, data)
    elif measured.held or measured.picture is not None:
        fail("--hold-out, --picture: modes have no measured response. Remove the option.")
    return table, found


def _read_universal_file(
    paths: list[Path], measured: _MeasuredOptions, data: dict[str, Any]
) -> tuple[ModeTable, MeasuredModes | None]:
    """Return the modes of a universal file, and their check if it holds responses."""
    if measured.exponential_window is not None:
        fail("--exponential-window: is for records of hits. Remove the option.")
    if len(paths) != 1:
        fail(f"--from: {len(paths)} files are given. Give one universal file.")
    [path], actuator, sensor = paths, measured.actuator, measured.sensor
    points = universal.Points(
        universal.node_of("contact", measured.contact or ""),
        None if actuator is None else universal.node_of("actuator", actuator),
        None if sensor is None else universal.node_of("sensor", sensor),
        measured.direction,
    )
    need("pyuff")
    sets = universal.read_sets(path)
    in_units = universal.units_of(sets, path, measured.units)
    if not universal.holds_modes(sets, measured.kind, path):
        found = _modes_from_responses(path, sets, points, measured)
        return found.table, found
    modes_found = universal.modes_of_sets(
        sets,
        path,
        points,
        in_units,
        unit_mass=bool(measured.unit_modal_mass),
        loss_factor=measured.loss_factor,
    )
    return _report_file_modes(modes_found, data), None


def _say_written(
    table: ModeTable, setup: Setup, warning: str, target: Path, base: str
) -> float | None:
    """Say what was written; return the expected error of the first impact, None if the scene cannot
    be run yet."""
    beside = target.with_suffix(".toml")
    found = f"{len(table.omega_rad_s)} modes from {_hz(table, 0):.5g} to {_hz(table, -1):.5g} Hz."
    expected = None
    if warning:
        out.say(f"{found} The scene cannot be run yet: {warning}.")
    else:
        expected = model_error.expected_error(setup)
        out.say(
            f"{found} Expected error of the first impact in this scene: {100 * expected:.2g} %."
        )
    then = shlex.join(["hertzloop", "run", str(beside)])
    out.say(
        f"written: {target} and {beside}, which has striker, material of the plate "
        f"({setup.plate_material or 'own numbers'}) and law of {base}."
        + ("" if warning else f" Next: {then}")
    )
    return expected


def _report_file_modes(found: "UniversalModes", data: dict[str, Any]) -> ModeTable:
    """Return the modes of a file, say how they were read, and add that to `data`."""
    out.print(f"Direction {found.direction}, units of the file: {found.units.name}.")
    if found.most_complex:
        out.say(
            "The shapes are complex. The imaginary part of the nearest real shapes is at most "
            f"{100 * found.most_complex:.2g} % of the largest value."
        )
    if found.undamped:
        out.print("The file has no damping. Give --loss-factor to set it.")
    data |= {
        "direction": found.direction,
        "units": found.units.name,
        "largest_imaginary_part": found.most_complex,
        "undamped": found.undamped,
    }
    return found.table


def _modes_from_responses(
    path: Path, sets: list[dict[str, Any]], points: "Points", measured: _MeasuredOptions
) -> MeasuredModes:
    """Return the modes of frequency responses."""
    held = measured.held
    if len(held) > 1:
        fail(f"--hold-out: {len(held)} files are given. Give one universal file.")

    def read(sets: list[dict[str, Any]], path: Path) -> FrequencyResponses:
        in_units = universal.units_of(sets, path, measured.units)
        return responses_of_sets(sets, path, points, in_units, measured.kind, measured.reference)

    responses = read(sets, path)
    other = read(universal.read_sets(held[0], "--hold-out"), held[0]) if held else None
    out.say(
        f"{responses.kind.capitalize()} of the nodes {', '.join(map(str, responses.nodes))} to a "
        f"force at {responses.reference}, direction {responses.direction}, "
        f"{responses.hz[0]:.5g} to {responses.hz[-1]:.5g} Hz."
    )
    with _progress() as tell:
        return modes_of_responses(responses, other, points, tell)


def _modes_from_hits(
    paths: list[Path], held: list[Path], at_contact: bool, window_s: float | None
) -> MeasuredModes:
    """Return the modes of records of hits."""
    hits = [replace(hit, window_s=window_s) for hit in read_hits(paths)]
    predicted = read_hits(held, "--hold-out") if held else []
    predicted = [replace(hit, window_s=window_s) for hit in predicted]
    with _progress() as tell:
        return modes_of_hits(hits, predicted, at_contact, tell)


@contextmanager
def _progress() -> Iterator[ModesCallback]:
    with progress("modes", 1, lines=True) as advance:
        yield lambda name, count, error: advance(
            0, f"{name} held out: {count} modes, error {error:.3g}"
        )


def _say_check(found: MeasuredModes, data: dict[str, Any]) -> None:
    """Print the errors of what was held out, and add them to `data`."""
    table = Table("held out", "modes", "error / rms, %", "largest error / peak, %")
    for one in found.held_out:
        table.add_row(one.name, str(one.modes), f"{100 * one.rms:.2f}", f"{100 * one.peak:.2f}")
    out.print(table)
    for note in found.notes:
        out.say(note)
    if found.delay_s:
        data["delay_s"] = found.delay_s
    data["held_out"] = [
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


def _scene_and_settings(scene: str, settings: list[str]) -> str:
    """A scene with what --set changed, on one line."""
    changed = ", ".join(" ".join(one.split()) for one in settings)
    return f"{scene} with {changed}" if changed else scene


def _missing_contact(path: Path, kind: str | None, units: str | None) -> str:
    """What is missing beside --contact, in one sentence each."""
    missing = ["--contact: is missing. Give the node of the contact point; of records, a name."]
    if path.suffix.lower() in universal.SUFFIXES and path.is_file():
        need("pyuff")
        sets = universal.read_sets(path)
        in_units = universal.units_of(sets, path, units)
        if universal.holds_modes(sets, kind, path) and in_units is None:
            missing.append(universal.unknown_units(path))
    return " ".join(missing)


def _write(table: ModeTable, target: Path, scene: str, settings: list[str]) -> tuple[Setup, str]:
    """Write a file of modes, and a scene with them beside it. Returns the scene, and why modes that
    end too low for its striker, or have no residual flexibility, cannot be simulated in it."""
    content = write_modes(target.suffix, table)
    data = with_modes_file(scene, settings, target.name, scene_name(target))
    base = _scene_and_settings(scene, settings)
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
    atomic_write(target, content)
    atomic_write(target.with_suffix(".toml"), text)
    return setup, warning


def _write_scene_modes(
    scene: str,
    out_file: Path | None,
    settings: list[str],
    grid: bool,
    overwrite: bool,
    json_file: Path | None,
) -> None:
    """Write the modes of a scene's plate."""
    resolved = prepare.scene_from(scene, settings, None)
    target = _target(out_file or Path(f"{resolved.name}-modes.csv"))
    if grid and target.suffix != ".npz":
        fail(f"--out = {target}: cannot hold shapes on a grid. Use an .npz file with --grid.")
    outputs.check_output(target, overwrite, read=outputs.files_of(resolved, scene, *settings))
    outputs.check_json(json_file, target)

    table = modes_of_scene(resolved, grid)
    atomic_write(target, write_modes(target.suffix, table))
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
