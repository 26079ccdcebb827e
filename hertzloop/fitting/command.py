"""The command `fit`: from measured records to a calibrated scene."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.terminal import fail, out, progress
from hertzloop.common.atomic_files import atomic_write
from hertzloop.common.text_files import text_of
from hertzloop.fitting.errors import FitError
from hertzloop.fitting.fit.check import check as check_records
from hertzloop.fitting.fit.check import expected_record
from hertzloop.fitting.fit.fit import fit as fit_records
from hertzloop.fitting.fit.free_keys import FreeKey, is_control_key, parse_free_key
from hertzloop.fitting.fit.report import (
    as_json,
    describe_record,
    fitted_scene,
    parameter_table,
    sentences,
    write_picture,
)
from hertzloop.fitting.fit.results import FitResult, ModelVerdict
from hertzloop.fitting.records.reading import holds_records, input_files, read_records
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup

_OF_FIT = ("--exact", "--hold-out", "--out", "--picture")
_OF_SCENE = ("--expect", "--json", "--set")


@dataclass(frozen=True)
class FitFiles:
    """The files of a fit; None for one that is not wanted.

    Attributes:
        scene: the fitted scene.
        picture: measured over simulated values.
        json: the file of --json, or standard output.
    """

    scene: Path | None
    picture: Path | None
    json: Path | None

    def check(self, read: list[Path], overwrite: bool, named: bool) -> None:
        """End the command unless all files can be written.

        Args:
            read: files that the command reads.
            overwrite: whether existing files may be replaced.
            named: whether the user names the fitted scene. Without a name, an earlier fitted scene
                is replaced.
        """
        if self.scene is not None:
            own = not named and _written_by_fit(self.scene)
            outputs.check_output(self.scene, overwrite or own, read=read)
        if self.picture is not None:
            outputs.check_picture(self.picture)
            outputs.check_output(self.picture, overwrite, "--picture", read=read)
        outputs.check_json(self.json, self.scene, self.picture)

    def write(self, result: FitResult) -> None:
        """Write the files, the fitted scene only if the records identify its keys."""
        data = as_json(result)
        if self.scene is not None and result.setup is not None and result.identifiable:
            atomic_write(self.scene, fitted_scene(result, self.scene.stem))
            data["scene"] = str(self.scene)
            out.say(f"written: {self.scene}")
        if self.picture is not None:
            write_picture(result, self.picture)
            out.say(f"written: {self.picture}")
        outputs.write_json(self.json, data)


def _written_by_fit(path: Path) -> bool:
    """Whether a file is a fitted scene, which may be replaced without asking."""
    try:
        return "\n[fit]\n" in text_of(path.read_bytes())
    except (OSError, ValueError):
        return False


def fit(
    scene: options.SceneArgument,
    records: Annotated[
        list[Path] | None, typer.Argument(metavar="RECORD...", help="Files of measured records.")
    ] = None,
    free: Annotated[
        list[str] | None,
        typer.Option(
            "--free",
            metavar="KEY[=LOW:HIGH][±PRIOR]",
            help="Fit this scene key, within a range, with a prior standard deviation in its "
            "unit or in %.",
        ),
    ] = None,
    hold_out: Annotated[
        list[Path] | None,
        typer.Option(
            "--hold-out",
            metavar="RECORD",
            help="Compare this record with the result; do not fit it.",
        ),
    ] = None,
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Report what the records can tell; do not fit. Without a scene, show what "
            "is read of them.",
        ),
    ] = False,
    expect: Annotated[
        list[str] | None,
        typer.Option(
            "--expect",
            metavar="QUANTITY:DURATIONus:NOISE%[:RATEMHz]",
            help="With --check, suppose a record of this kind, before the experiment.",
        ),
    ] = None,
    exact: Annotated[
        bool, typer.Option("--exact", help="Take the model as exact: only noise spoils a record.")
    ] = False,
    out_file: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Fitted scene to write; SCENE-fitted.toml if left out."),
    ] = None,
    picture_file: Annotated[
        Path | None,
        typer.Option("--picture", help="Draw measured over simulated values to this file."),
    ] = None,
    settings: options.SetOption = None,
    json_file: options.JsonOption = None,
    overwrite: options.OverwriteOption = False,
) -> None:
    """Fit keys of a scene to measured records.

    It prints estimates with 95 % intervals, and verdicts on the keys and on the model.

    Exit codes: 0 the model fits, or the records cannot tell; 1 it does not fit; 2 a mistake, or a
    key that the records cannot identify.
    """
    given = {
        "--exact": exact,
        "--expect": expect,
        "--hold-out": hold_out,
        "--json": json_file,
        "--out": out_file,
        "--picture": picture_file,
        "--set": settings,
    }
    without_scene = check and not free and holds_records(Path(scene))
    _refuse_unused([option for option, value in given.items() if value], check, without_scene)
    files = list(records or [])
    if without_scene:
        for file in (Path(scene), *files):
            for one in read_records(file):
                out.say("\n".join(describe_record(one)))
        return
    setup = prepare.scene_from(scene, settings, None)
    held = hold_out or []
    scene_file = None if check else out_file or Path(f"{setup.scene.name}-fitted.toml")
    written = FitFiles(scene_file, picture_file, json_file)
    read = outputs.files_of(setup, scene, *(settings or []))
    read += [one for file in (*files, *held) for one in input_files(file)]
    written.check(read, overwrite, named=out_file is not None)
    keys = [parse_free_key(setup, text) for text in free or []]
    if not keys:
        raise FitError("--free: no key is free. Name at least one, --free KEY.")
    measured = [one for path in files for one in read_records(path)]
    compared = [one for path in held for one in read_records(path)]
    for one in (*measured, *compared):
        out.say(f"{one.name}: {one.source}.")
    prepare.compile_first(setup)
    measured += _expected_records(setup, expect or [], keys)
    if not measured:
        remedy = "RECORD, or --expect" if check else "RECORD"
        raise FitError(f"RECORD: none is given. Name at least one {remedy}.")
    if check:
        result = check_records(setup, measured, keys)
    else:
        result = _fit_with_progress(setup, measured, keys, compared, exact)
    out.print(parameter_table(result))
    for sentence in sentences(result):
        out.say(sentence)
    written.write(result)
    if not result.identifiable:
        raise typer.Exit(2)
    if result.model is ModelVerdict.DOES_NOT_FIT:
        raise typer.Exit(1)


def _refuse_unused(given: list[str], check: bool, without_scene: bool) -> None:
    """End the command for an option that it would not use.

    Args:
        given: names of options that are given.
        check: whether --check is one.
        without_scene: whether only records are given, which are described.
    """
    for option in given:
        if check and option in _OF_FIT:
            fail(f"{option}: is part of a fit, and --check makes none. Remove one of the two.")
        if without_scene and option in _OF_SCENE:
            fail(f"{option}: needs a scene, and only records are given. Name a scene before them.")
        if option == "--expect" and not check:
            fail("--expect: supposes a record, which cannot be fitted. Add --check.")


def _expected_records(setup: Setup, texts: list[str], keys: list[FreeKey]) -> list[Record]:
    """Return made-up records; if a key of the law is free, all are under the law."""
    control = True if any(is_control_key(f.key) for f in keys) else None
    return [
        expected_record(setup, text, f"expected record {i}", control)
        for i, text in enumerate(texts, 1)
    ]


def _fit_with_progress(
    setup: Setup,
    records: list[Record],
    keys: list[FreeKey],
    hold_out: list[Record],
    exact: bool,
) -> FitResult:
    """Fit keys to records, and show the number of simulations."""
    with progress("fit", 1000) as advance:

        def show(done: int, expected: int) -> None:
            about = f"fit: {done} of about {expected} simulations"
            advance(round(1000 * done / expected), about)

        return fit_records(setup, records, keys, hold_out, show, exact)
