"""The commands `hertzloop law ...`: list, new, replay, test."""

import inspect
import shlex
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hertzloop.bus.port import BusError
from hertzloop.bus.sockets import own_folder
from hertzloop.bus.streams import StreamFault
from hertzloop.cli import options
from hertzloop.cli.terminal import err, fail, out
from hertzloop.controller.loading.registry import compilation, find, shipped
from hertzloop.loop.run_options import RunOptions
from hertzloop.processes import fork_server
from hertzloop.processes.controller_check import (
    WrongForce,
    cases_of,
    compare_blocks,
    compare_with_law,
    law_of,
    run_case,
)
from hertzloop.processes.launcher import RunFailed
from hertzloop.processes.program import BUS_NAME, check_command, meeting_endpoints
from hertzloop.recordings.reader import Recording, read
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.recorded import reported_law
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.loading import parse_setting
from hertzloop.views.format import Table

if TYPE_CHECKING:
    from hertzloop.studies.law_on import ForceComparison


def list_laws() -> None:
    """List the shipped laws and their keys."""
    table = Table("law", "senses", "keys", "what it does")
    for name in shipped():
        law = find(name)
        text = inspect.getdoc(law.home) or ""
        table.add_row(name, law.senses, ", ".join(law.keys.model_fields), text.split("\n\n")[0])
    out.print(table)


def new(
    file: Annotated[Path, typer.Argument(metavar="F.py|F.c")],
    with_check: bool = False,
) -> None:
    """Write a commented law in Python or C that runs without changes.

    A law in C gets the header hertzloop_law.h beside it.

    Args:
        file: Write this new file.
        with_check: Write requirements.toml and a workflow for continuous integration beside it.
    """
    then = _next(file, with_check)
    options.write_new(file, (".py", ".c"), "law", lambda: _start_of(file, with_check), then)


def _start_of(file: Path, with_check: bool) -> dict[Path, str]:
    texts = {file: _resource(f"law{file.suffix}.txt").replace("NAME", file.stem)}
    header = file.with_name("hertzloop_law.h")
    if file.suffix == ".c" and not header.exists():
        texts[header] = _resource("hertzloop_law.h")
    for name in ("requirements.toml", "workflow.yml") if with_check else ():
        beside = file.with_name(name)
        if beside.exists():
            fail(f"{beside} exists. Move it, or omit --with-check.")
        text = _resource(f"{name}.txt").replace('law = "FILE"', f'law = "{_runs(file).name}"')
        texts[beside] = text.replace("FILE", file.name)
    if file.suffix == ".c" and with_check:
        compiled = f"      - run: {compilation(Path(file.name))}\n"
        before, check, after = texts[beside].partition("      - run: hertzloop budget")
        texts[beside] = before + compiled + check + after
    return texts


def _runs(file: Path) -> Path:
    return file.with_suffix(".so") if file.suffix == ".c" else file


def _resource(name: str) -> str:
    return (resources.files("hertzloop.controller") / "loading" / "start" / name).read_text("utf-8")


def _next(file: Path, with_check: bool) -> str:
    words = ["run", "--set", f"controller.law={_runs(file)}"]
    if with_check:
        words = ["budget", "--check", str(file.with_name("requirements.toml"))]
    run = shlex.join(["hertzloop", *words])
    return f"{compilation(file)} && {run}" if file.suffix == ".c" else run


def replay(
    file: Annotated[Path, typer.Argument(metavar="F.mcap")],
    law: str,
    settings: options.SetOption = None,
    picture: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    overwrite: options.OverwriteOption = False,
    json_file: options.JsonOption = None,
) -> None:
    """Feed a recording's samples to another law and show where the forces differ.

    Args:
        file: Recording to read.
        law: Feed the recorded samples to this law.
        picture: Write the picture here; default: F-law.png.
    """
    from hertzloop.studies import law_on as law_replay  # of an extra

    target = picture or file.with_name(f"{file.stem}-law.png")
    options.check_picture(target)
    options.check_output(target, overwrite, read=[file])
    options.check_json(json_file, target)
    recording = read(file)
    keys = dict(parse_setting(text) for text in settings or [])
    setup = law_replay.scene_with(recording, law, keys)
    found = law_replay.law_on(recording, setup)
    for problem in recording.problems:
        err.say(f"{file}: {problem}")
    if note := loaded_law(setup).identity_note():
        err.say(note)
    ran = reported_law(recording)[0] or recording.metadata.get("law") or "as recorded"
    law_replay.draw(found, (f"recorded: {ran}", loaded_law(setup).name), target)
    out.say(_difference(found, loaded_law(setup).name))
    out.say(f"written: {target}")
    options.write_json(json_file, {"steps": len(found.other_n), "first_difference": found.first})


def _difference(found: "ForceComparison", name: str) -> str:
    if found.first is None:
        return f"the same forces in all {len(found.other_n):,} steps"
    at = found.first
    return (
        f"the forces differ first at step {at} ({1e3 * at * found.step_s:.6g} ms): recorded "
        f"{found.recorded_n[at]:.9g} N, {name} {found.other_n[at]:.9g} N"
    )


@options.takes(only=("controller", "name", "timeout_s"))
def controller_test(
    request: RunOptions,
    law: str | None = None,
    settings: options.SetOption = None,
    port: Annotated[int | None, typer.Option(min=1, max=65533)] = None,
) -> None:
    """Test your own controller program in short runs.

    The plant names the first thing that the program does wrong.

    Args:
        law: Require the forces of this law, byte for byte.
        port: First of three ports: plant's, controller's, recorder's. Default: free ones if CMD has
            {listen}, else those from 7450 on.
    """
    command = request.controller
    if command is None:
        fail("--controller: missing. Give the command line of your program.")
    check_command(command)
    cases = cases_of(law, settings or [])
    options.compile_first(*(case.setup for case in cases))
    fork_server.prepare()  # before anything starts a thread
    name = request.name or (None if "{name}" in command else BUS_NAME)
    recordings: list[Recording] = []
    for case in cases:
        try:
            with meeting_endpoints(command, port) as endpoints, own_folder() as folder:
                meeting = replace(request, endpoints=endpoints, name=name)
                recordings.append(run_case(case, meeting, Path(folder)))
            if law:
                compare_with_law(recordings[-1], case.setup)
            if case.horizon:
                compare_blocks(recordings[-1], recordings[0], case.setup)
        except (RunFailed, RecordingError, StreamFault, BusError, WrongForce) as error:
            fail(f"{case.name}: {error}", 1)
    ran = law_of(recordings[0])
    err.say(f"its law: {ran}" if ran else "it does not say which law ran (report.law)")
    forces = sum(case.setup.steps for case in cases)
    out.print(f"conforms: {len(cases)} runs, {forces:,} forces")
