"""The command `scene modes`: modes of a scene's plate, or measured ones, as a file of modes."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from hertzloop.cli import options, outputs
from hertzloop.cli.terminal import fail, out
from hertzloop.fitting.commands.measured_modes import MeasuredOptions, read_measured_modes
from hertzloop.fitting.commands.mode_files import (
    ModesOutput,
    mode_hz,
    write_measured_modes,
    write_plate_modes,
)
from hertzloop.scene.loading import DEFAULT, shipped


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
    output = ModesOutput(scene, settings or [], out_file, json_file, overwrite)
    measured = MeasuredOptions(
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
        write_plate_modes(output, grid)
        return
    if grid:
        fail("--grid: measured modes have no shapes on a grid. Leave it out.")
    _write_measured(list(map(Path, files)), measured, output)


def _write_measured(paths: list[Path], measured: MeasuredOptions, output: ModesOutput) -> None:
    """Read the modes of measured files, and write them with a scene and a picture."""
    picture = measured.picture
    target = output.target(paths[0].stem)
    beside, read = target.with_suffix(".toml"), [*paths, *measured.held, Path(output.scene)]
    for path in (target, beside):
        outputs.check_output(path, output.overwrite, read=read)
    if picture is not None:
        outputs.check_picture(picture)
        outputs.check_output(picture, output.overwrite, "--picture", read)
    outputs.check_json(output.json_file, target, beside, picture)
    data: dict[str, Any] = {}
    table, found = read_measured_modes(paths, measured, data)
    written = write_measured_modes(table, target, output)
    if picture is not None and found is not None:
        from hertzloop.fitting.modes.picture import draw  # An extra installs matplotlib.

        draw(found, picture)
        out.print(f"written: {picture}")
    data |= {
        "modes": len(table.omega_rad_s),
        "lowest_hz": mode_hz(table, 0),
        "highest_hz": mode_hz(table, -1),
        "residual_flexibility_m_n": table.residual_flexibility_m_n,
        "expected_error": written.expected_error,
        "warning": written.warning or None,
        "files": [str(path) for path in written.files],
    }
    outputs.write_json(output.json_file, data)


def _scene_and_files(names: list[str], source: str | None) -> tuple[str, list[str]]:
    """Return the scene and the files of --from.

    A shell expands a pattern to a word for each file, so all but the first stand beside the scene.
    """
    scenes = [name for name in names if name in shipped() or name.endswith(".toml")]
    files = [name for name in names if name not in scenes]
    if source is None:
        scenes, files = [*scenes, *files], []
    if len(scenes) > 1:
        fail(f"SCENE = {', '.join(scenes)}: is more than one scene. Give one.")
    return scenes[0] if scenes else DEFAULT, [source, *files] if source is not None else []
