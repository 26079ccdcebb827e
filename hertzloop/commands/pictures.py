"""The command that takes pictures of the replay: every shipped scene, a comparison, an unstable
run, a paced one."""

import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from hertzloop.commands.options import make_folder
from hertzloop.commands.terminal import fail, out

_REPORT = "report"
_BROWSERS = ("chromium", "chromium-browser", "chrome")


def pictures(
    folder: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for the pictures.", metavar="DIR")
    ],
    only: Annotated[
        list[str] | None, typer.Option("--only", help="A picture by its name; repeat for more.")
    ] = None,
    documented: Annotated[
        bool,
        typer.Option("--docs", help="Those of the documentation instead, each by its command."),
    ] = False,
    note: Annotated[
        bool, typer.Option("--note", help="With --docs: only note what they show today.")
    ] = False,
) -> None:
    """Pictures of the replay: every shipped scene over itself without control, two laws compared,
    an unstable run, a paced one; --only report: the page of a run. No screen needed; a quarter of
    a minute each."""
    from hertzloop.scenes.scene import shipped
    from hertzloop.views import replaying
    from recordings.reader import read
    from recordings.writer import RecordingError
    from studies.drawn import MORE, Run

    if documented:
        _documented(folder, only, note)
        return
    wanted = {name: [Run(name)] for name in shipped()} | MORE
    _check(only, [*wanted, _REPORT])
    make_folder(folder)
    if _REPORT in (only or ()):
        _photograph_report(folder / f"{_REPORT}.png")
    for name in [name for name in only or wanted if name != _REPORT]:
        with TemporaryDirectory(prefix="hertzloop-") as temporary:
            files = []
            for i, run in enumerate(wanted[name]):
                files.append(Path(temporary) / f"{run.scene}{'-other' * i}.mcap")
                try:
                    run.record(files[-1])
                except RuntimeError as error:
                    fail(str(error), 1)
            first, *others = (read(file) for file in files)
            try:
                picture = folder / f"replay-{name}.png"
                replaying.replay(first, None, picture, others[0] if others else None)
            except RecordingError as error:
                fail(str(error), 1)
        out.print(f"written: {picture}", soft_wrap=True)


def _check(only: list[str] | None, known: list[str]) -> None:
    unknown = [name for name in only or [] if name not in known]
    if unknown:
        fail(f"there is no picture '{unknown[0]}'; there are {', '.join(known)}", 2)


def _documented(folder: Path, only: list[str] | None, note: bool) -> None:
    """Draw the pictures of the documentation again, hours for all, and note what they show."""
    from studies import drawn

    _check(only, list(drawn.PICTURES))
    make_folder(folder)
    for name in only or drawn.PICTURES:
        picture = drawn.PICTURES[name]
        if not note:
            with TemporaryDirectory(prefix="hertzloop-") as temporary:
                words = picture.command.replace("DIR", temporary).split()
                done = subprocess.run([sys.executable, "-m", *words], check=False)
                if done.returncode:
                    fail(f"'{picture.command}' ended with code {done.returncode}", 1)
                shutil.copyfile(Path(temporary) / picture.writes, folder / name)
        drawn.write_note(folder, name, drawn_again=not note)
        out.print(f"{'noted' if note else 'written'}: {folder / name}", soft_wrap=True)


def _photograph_report(picture: Path) -> None:
    """The top of the page of the scene `aluminium-3mm`, by Chromium."""
    from recordings.reader import read
    from studies.drawn import Run
    from studies.report.page import page_of

    browser = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if browser is None:
        fail(f"the picture of the page needs a browser: {', '.join(_BROWSERS)}", 1)
    with TemporaryDirectory(prefix="hertzloop-") as temporary:
        file, page = Path(temporary) / "aluminium-3mm.mcap", Path(temporary) / "page.html"
        Run("aluminium-3mm").record(file)
        page.write_text(page_of(read(file)), encoding="utf-8")
        command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
        command += [f"--user-data-dir={temporary}/profile", "--window-size=1100,2500"]
        command += ["--virtual-time-budget=1500", f"--screenshot={picture}", page.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode or not picture.exists():
        fail(f"{browser} took no picture: {done.stderr.strip()[-200:]}", 1)
    out.print(f"written: {picture}", soft_wrap=True)
