"""The command that makes a page to send to somebody, of a run, a sweep or a tuning."""

import os
from pathlib import Path
from typing import Annotated

import typer

from hertzloop.commands.options import OverwriteOption, check_output, make_folder
from hertzloop.commands.recordings import read_or_fail
from hertzloop.commands.terminal import err, fail, out
from hertzloop.extras import need


def report(
    source: Annotated[
        Path,
        typer.Argument(
            help="A recording, the results of a sweep or of tune, or the folder of these.",
            metavar="F.mcap|RESULTS",
        ),
    ],
    folder: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for the page.", metavar="DIR")
    ],
    overwrite: OverwriteOption = False,
) -> None:
    """One HTML page that needs nothing else. Of a run: figures, charts, animation of the plate,
    sound, scene, how to run it again; of a sweep or a tuning: charts, tables of cases, scene."""
    need("matplotlib", "jinja2")
    if source.suffix in (".parquet", ".csv", ".json", ".partial") or os.path.isdir(source):
        _of_results(source, folder, overwrite)
    else:
        _of_run(source, folder, overwrite)


def _of_run(file: Path, folder: Path, overwrite: bool) -> None:
    from hertzloop.scenes.errors import SceneError
    from recordings.writer import RecordingError

    recording = read_or_fail(file, keep=True)
    page = _page(file, folder, overwrite)
    for problem in recording.problems:
        err.print(f"{file}: {problem}", soft_wrap=True)
    from studies.report.page import page_of

    try:
        _write(page, page_of(recording))
    except (RecordingError, SceneError) as error:
        fail(str(error), 1)


def _of_results(source: Path, folder: Path, overwrite: bool) -> None:
    from hertzloop.scenes.errors import SceneError
    from studies.report.results import page_of_results, results_in

    try:
        results = results_in(source)
        text = page_of_results(results)
    except (ValueError, SceneError) as error:
        fail(str(error), 2)
    _write(_page(results, folder, overwrite), text)


def _page(source: Path, folder: Path, overwrite: bool) -> Path:
    """Where the page goes; ends the command if it cannot."""
    make_folder(folder)
    page = folder / f"{source.stem}.html"
    check_output(page, overwrite, read=[source])
    return page


def _write(page: Path, text: str) -> None:
    try:
        page.write_text(text, encoding="utf-8")
    except OSError as error:
        fail(f"cannot write {page}: {error.strerror}", 1)
    out.print(f"written: {page} ({len(text.encode()) / 1e6:.1f} MB)", soft_wrap=True)
