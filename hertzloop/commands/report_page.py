"""The command that makes a page of a run to send to somebody."""

from pathlib import Path
from typing import Annotated

import typer

from hertzloop.commands.options import OverwriteOption, check_output, make_folder
from hertzloop.commands.recordings import FileArgument, read_or_fail
from hertzloop.commands.terminal import err, fail, out


def report(
    file: FileArgument,
    folder: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for the page.", metavar="DIR")
    ],
    overwrite: OverwriteOption = False,
) -> None:
    """One HTML page of a run that needs nothing else: figures, charts, animation of the plate,
    sound, scene, how to run it again."""
    from hertzloop.scenes.scene import SceneError
    from recordings.writer import RecordingError

    recording = read_or_fail(file)
    make_folder(folder)
    page = folder / f"{file.stem}.html"
    check_output(page, overwrite)
    for problem in recording.problems:
        err.print(f"{file}: {problem}", soft_wrap=True)
    from studies.report.page import page_of

    try:
        text = page_of(recording)
        page.write_text(text, encoding="utf-8")
    except (RecordingError, SceneError) as error:
        fail(str(error), 1)
    except OSError as error:
        fail(f"cannot write {page}: {error.strerror}", 1)
    out.print(f"written: {page} ({len(text.encode()) / 1e6:.1f} MB)", soft_wrap=True)
