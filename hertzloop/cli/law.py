"""The commands `hertzloop law ...`: list, new, replay, test."""

import inspect
import shlex
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hertzloop.bus.port import BusError
from hertzloop.bus.sockets import own_folder
from hertzloop.bus.streams import StreamFault
from hertzloop.cli import outputs, prepare
from hertzloop.cli.options import FileArgument, JsonOption, SetOption, run_options
from hertzloop.cli.terminal import err, fail, out, say_problems
from hertzloop.controller.loading.registry import compilation, find, shipped
from hertzloop.loop.run_options import RunOptions
from hertzloop.processes.controller_check import (
    WrongForce,
    cases_of,
    compare_blocks,
    compare_with_law,
    law_of,
    run_case,
)
from hertzloop.processes.launcher import RunFailed
from hertzloop.processes.program import check_command, meeting_endpoints, name_on_bus
from hertzloop.recordings.reader import Recording, read
from hertzloop.recordings.writer import RecordingError
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.loading import parse_setting
from hertzloop.views.format import Table

if TYPE_CHECKING:
    from hertzloop.studies.law_replay import ForceComparison


def list_laws() -> None:
    """List the shipped laws and their keys."""
    table = Table("law", "senses", "keys", "what it does")
    for name in shipped():
        law = find(name)
        text = inspect.getdoc(law.home) or ""
        table.add_row(name, law.senses, ", ".join(law.keys.model_fields), text.split("\n\n")[0])
    out.print(table)


def new(
    file: Annotated[Path, typer.Argument(metavar="F.py|F.c", help="Write this new file.")],
    with_check: Annotated[
        bool,
        typer.Option(
            "--with-check",
            help="Write requirements.toml and a workflow for continuous integration beside it.",
        ),
    ] = False,
) -> None:
    """Write a commented law in Python or C that runs without changes.

    A law in C gets the header hertzloop_law.h beside it.
    """
    then = _next_command(file, with_check)
    outputs.write_new(file, (".py", ".c"), "law", lambda: _start_of(file, with_check), then)


def _start_of(file: Path, with_check: bool) -> dict[Path, str]:
    """Return the files of a new law, with their texts."""
    texts = {file: _resource(f"law{file.suffix}.txt").replace("NAME", file.stem)}
    header = file.with_name("hertzloop_law.h")
    if file.suffix == ".c" and not header.exists():
        texts[header] = _resource("hertzloop_law.h")
    return texts | (_checks_of(file) if with_check else {})


def _checks_of(file: Path) -> dict[Path, str]:
    """Return the requirements of a new law, and the workflow that checks them."""
    texts = {}
    for name in ("requirements.toml", "workflow.yml"):
        path = file.with_name(name)
        if path.exists():
            fail(f"{path} exists. Move it, or omit --with-check.")
        text = _resource(f"{name}.txt")
        text = text.replace('law = "FILE"', f'law = "{_loadable(file).name}"')
        texts[path] = text.replace("FILE", file.name)
    if file.suffix == ".c":
        compiled = f"      - run: {compilation(Path(file.name))}\n"
        workflow = file.with_name("workflow.yml")
        before, check, after = texts[workflow].partition("      - run: pytest")
        texts[workflow] = before + compiled + check + after
    return texts


def _loadable(file: Path) -> Path:
    """Return the file that a scene names as its law: of a law in C, the compiled library."""
    return file.with_suffix(".so") if file.suffix == ".c" else file


def _resource(name: str) -> str:
    return (resources.files("hertzloop.controller") / "loading" / "start" / name).read_text("utf-8")


def _next_command(file: Path, with_check: bool) -> str:
    """Return the command that tries a new law; a law in C is compiled first."""
    words = ["run", "--set", f"controller.law={_loadable(file)}"]
    if with_check:
        words = ["budget", "--check", str(file.with_name("requirements.toml"))]
    command = shlex.join(["hertzloop", *words])
    return f"{compilation(file)} && {command}" if file.suffix == ".c" else command


def replay(
    file: FileArgument,
    law: Annotated[str, typer.Option(help="Feed the recorded samples to this law.")],
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Change a key of the law, for example controller.kappa=0.5."),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Feed a recording's samples to another law and say where the forces differ.

    The exit code is 1 if they differ. The samples stay as recorded: --set changes keys of the
    controller only.
    """
    from hertzloop.studies.law_replay import replay_law, scene_with

    outputs.check_json(json_file, file)
    prepare.check_given_once(settings or [], None)
    keys = dict(parse_setting(text) for text in settings or [])
    _check_keys(keys)
    recording = read(file)
    setup = scene_with(recording, law, keys)
    found = replay_law(recording, setup)
    say_problems(recording)
    out.say(_difference(found, loaded_law(setup).name))
    outputs.write_json(json_file, {"steps": len(found.other_n), "first_difference": found.first})
    if found.first is not None:
        raise typer.Exit(1)


def _check_keys(keys: dict[str, Any]) -> None:
    """End the command for a key that does not act on recorded samples, or that names the law."""
    for key, value in keys.items():
        if key == "controller.law":
            fail(f"--set {key} = {value!r}: --law names the law. Remove one of the two.")
        if not key.startswith("controller."):
            fail(
                f"--set {key} = {value!r}: has no effect on recorded samples. Set keys of "
                "[controller] only, or run the scene again."
            )


def _difference(found: "ForceComparison", name: str) -> str:
    """Say at which step the forces of two laws differ first."""
    if found.first is None:
        return f"the same forces in all {len(found.other_n):,} steps"
    at = found.first
    return (
        f"the forces differ first at step {at} ({1e3 * at * found.step_s:.6g} ms): recorded "
        f"{found.recorded_n[at]:.9g} N, {name} {found.other_n[at]:.9g} N"
    )


@run_options("name", "timeout_s", "controller", "max_exchange_steps")
def controller_test(
    law: Annotated[
        str | None, typer.Option(help="Require the forces of this law, byte for byte.")
    ] = None,
    settings: SetOption = None,
    port: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=65533,
            help="First of three ports: plant's, controller's, recorder's. Default: free "
            "ones if CMD has {listen}, else those from 7450 on.",
        ),
    ] = None,
    *,
    options: RunOptions,
) -> None:
    """Test your own controller program in short runs.

    The plant names the first thing that the program does wrong.
    """
    controller = options.controller
    if controller is None:
        fail("--controller: missing. Give the command line of your program.")
    check_command(controller)
    name = name_on_bus(controller, options.name)
    cases = cases_of(law, settings or [])
    prepare.compile_first(*(case.setup for case in cases))
    recordings: list[Recording] = []
    for case in cases:
        try:
            with meeting_endpoints(controller, port) as endpoints, own_folder() as folder:
                met = options.model_copy(update={"endpoints": endpoints, "name": name})
                recordings.append(run_case(case, met, Path(folder)))
            if law:
                compare_with_law(recordings[-1], case.setup)
            if case.max_exchange_steps:
                compare_blocks(recordings[-1], recordings[0], case.setup)
        except (RunFailed, RecordingError, StreamFault, BusError, WrongForce) as error:
            fail(f"{case.name}: {error}", 1)
    law_used = law_of(recordings[0])
    err.say(f"its law: {law_used}" if law_used else "it does not say which law ran (report.law)")
    forces = sum(case.setup.run.steps for case in cases)
    out.print(f"conforms: {len(cases)} runs, {forces:,} forces")
