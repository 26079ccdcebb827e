"""The commands `hertzloop law ...`: list, new, replay, test."""

import inspect
import shlex
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from hertzloop.analysis.recorded import reported_law
from hertzloop.cli import options
from hertzloop.cli.terminal import err, fail, out
from hertzloop.controller.loading.registry import compilation, find, shipped
from hertzloop.loop.run_options import BusOptions, RunOptions
from hertzloop.processes.conformance import Broken, Checks, Meeting, Script, play, recorded, scripts
from hertzloop.processes.program import BUS_NAME, check_command, meeting_endpoints
from hertzloop.recordings.reader import read
from hertzloop.scenes.loading import parse_setting
from hertzloop.setup.controller import loaded_law
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


@options.takes(only=("controller", "name", "timeout_s", "wait_s"), name=BUS_NAME)
def controller_test(
    request: RunOptions,
    bus: BusOptions,
    script: list[str] | None = None,
    law: str | None = None,
    expect: Annotated[Path | None, typer.Option(exists=True)] = None,
    settings: options.SetOption = None,
    port: Annotated[int | None, typer.Option(min=1, max=65533)] = None,
) -> None:
    """Test your own controller program against the wire protocol.

    It plays a plant to the controller, and prints the first thing that is wrong. Without
    --controller it waits for a program that runs already, and plays one script.

    Args:
        script: Play this script; repeatable; default with --controller: all.
        law: Require the forces of this law, byte for byte.
        expect: Play the samples of this recording and require its forces.
        port: First of three ports: plant's, controller's, recorder's. Default: free ones if CMD has
            {listen}, else those from 7450 on.
    """
    if law and expect:
        fail("--law: cannot be combined with --expect. Remove one of the two.")
    command = request.controller
    if command is not None:
        check_command(command)
    chosen = _chosen(script, law, expect, settings or [], everything=command is not None)
    checks = Checks()
    laws: set[str] = set()
    with meeting_endpoints(command or "", port) as endpoints:
        meeting = Meeting(request.name or BUS_NAME, endpoints, request.timeout_s, bus.wait_s)
        for one in chosen:
            try:
                laws |= _played(one, meeting, command or "", checks)
            except Broken as error:
                out.say(f"script '{one.name}': {error}")
                raise typer.Exit(1) from None
            except OSError as error:
                fail(f"--controller = '{command}': cannot be started: {error}")
    for text in sorted(laws):
        said = f"its law: {text}" if text else "it does not say which law ran (set_up.law)"
        err.say(said)
    out.print(f"conforms: {checks.count:,} checks")


def _chosen(
    names: list[str] | None,
    law: str | None,
    expect: Path | None,
    settings: list[str],
    everything: bool,
) -> list[Script]:
    """The scripts to play; ends the command where there are none such."""
    try:
        if expect:
            return [recorded(read(expect))]
        if law:
            options.compile_first()
        known = {script.name: script for script in scripts(law, settings)}
    except ValueError as error:
        fail(str(error))
    wanted = names or (list(known) if everything else ["touch"])
    for name in wanted:
        if name not in known:
            fail(f"--script = '{name}': unknown script. Use one of {', '.join(known)}.")
    if not everything and len(wanted) > 1:
        fail("--script: a running controller plays one script. Use --controller 'CMD' for several.")
    return [known[name] for name in wanted]


def _played(script: Script, meeting: Meeting, command: str, checks: Checks) -> set[str]:
    """Play a script at each of its horizons, once without `command`; the laws that ran.

    Raises Broken and OSError as `conformance.play`.
    """
    laws, before = set(), None
    for horizon in script.horizons if command else script.horizons[-1:]:
        plant = play(script, horizon, meeting, command, checks)
        if plant.end is not None:
            laws.add(plant.end.set_up.law)
        if before is not None:
            other = np.flatnonzero(before.view(np.int64) != plant.forces.view(np.int64))
            at = int(other[0]) if len(other) else 0
            checks.that(
                not len(other),
                f"the force of step {at} is {before[at]:g} N with an exchange every step, "
                f"{plant.forces[at]:g} N with as few as were granted: the horizon changes no force",
            )
        before = plant.forces
    return laws
