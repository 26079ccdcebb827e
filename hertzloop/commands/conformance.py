"""The command `conformance`."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hertzloop.commands.options import (
    NameOption,
    SetOption,
    TimeoutOption,
    WaitOption,
    compile_first,
)
from hertzloop.commands.terminal import err, fail, out
from hertzloop.scenes.errors import SceneError

if TYPE_CHECKING:
    from hertzloop.processes.conformance import Checks, Meeting, Script


def conformance(
    start: Annotated[
        str,
        typer.Option(
            metavar="'CMD ...'",
            help="Command line that starts the controller; {name}, {listen} and {connect} in it "
            "are filled in. Without, one that runs already plays one script.",
        ),
    ] = "",
    script: Annotated[
        list[str] | None, typer.Option(help="Script to play, several times; all with --start.")
    ] = None,
    law: Annotated[
        str | None, typer.Option(help="Our law whose forces must come, byte for byte.")
    ] = None,
    expect: Annotated[
        Path | None,
        typer.Option(help="Recording: its samples are played, its forces must come.", exists=True),
    ] = None,
    settings: SetOption = None,
    name: NameOption = "hertzloop",
    port: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=65533,
            help="First of three ports: plant's, controller's, recorder's. If left out, free ones "
            "with --start, else those from 7450 on.",
        ),
    ] = None,
    timeout: TimeoutOption = 5.0,
    wait: WaitOption = 30.0,
) -> None:
    """Play a plant against a controller process of one's own; say what is wrong first."""
    from hertzloop.processes.conformance import Broken, Checks, Meeting

    if law and expect:
        fail("give --law or --expect, not both: the forces are compared with one of them", 2)
    chosen = _chosen(script, law, expect, settings or [], everything=bool(start))
    checks = Checks()
    laws: set[str] = set()
    with _ports(port, bool(start)) as ports:
        meeting = Meeting(name, ports, timeout, wait)
        for one in chosen:
            try:
                laws |= _played(one, meeting, start, checks)
            except Broken as error:
                out.print(f"script '{one.name}': {error}", soft_wrap=True)
                raise typer.Exit(1) from None
            except (OSError, ValueError) as error:
                fail(f"'{start}' cannot be started: {error}", 2)
    for text in sorted(laws):
        said = f"its law: {text}" if text else "it does not say which law ran (set_up.law)"
        err.print(said, soft_wrap=True)
    out.print(f"conforms: {checks.count:,} checks")


def _ports(first: int | None, ours_to_start: bool) -> AbstractContextManager[Sequence[int]]:
    """Ports of plant, controller and recorder; who runs already has to know them."""
    from bus.wire import reserved_ports
    from hertzloop.processes.roles import BASE_PORT

    if first is None and ours_to_start:
        return reserved_ports(3)
    first = first or BASE_PORT
    return nullcontext(range(first, first + 3))


def _chosen(
    names: list[str] | None,
    law: str | None,
    expect: Path | None,
    settings: list[str],
    everything: bool,
) -> list["Script"]:
    """The scripts to play; ends the command where there are none such."""
    from hertzloop.processes.conformance import recorded, scripts
    from recordings.reader import read
    from recordings.writer import RecordingError

    try:
        if expect:
            return [recorded(read(expect))]
        if law:
            compile_first()
        known = {script.name: script for script in scripts(law, settings)}
    except (SceneError, RecordingError, ValueError) as error:
        fail(str(error), 2)
    wanted = names or (list(known) if everything else ["touch"])
    for name in wanted:
        if name not in known:
            fail(f"there is no script '{name}'; known: {', '.join(known)}", 2)
    if not everything and len(wanted) > 1:
        fail("a controller that runs already plays one --script; --start 'CMD' plays several", 2)
    return [known[name] for name in wanted]


def _played(script: "Script", meeting: "Meeting", start: str, checks: "Checks") -> set[str]:
    """Play a script at each of its horizons, once without `start`; the laws that ran.

    Raises Broken, OSError and ValueError as `conformance.play`.
    """
    import numpy as np

    from hertzloop.processes.conformance import play

    laws, before = set(), None
    for horizon in script.horizons if start else script.horizons[-1:]:
        plant = play(script, horizon, meeting, start, checks)
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
