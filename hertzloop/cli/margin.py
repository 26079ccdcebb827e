"""The command that states the linear margin of a scene's loop."""

from dataclasses import asdict
from typing import Annotated, Any

import typer

from hertzloop.cli.options import (
    JsonOption,
    SceneArgument,
    SetOption,
    check_json,
    scene_from,
    write_json,
)
from hertzloop.cli.terminal import fail, out
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import DEFAULT


def margin(
    scene: SceneArgument = DEFAULT,
    law: Annotated[
        str | None, typer.Option("--law", help="Use this law instead of the scene's.")
    ] = None,
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Tell how stable a linear law's loop is in flight.

    It prints growth, latency limit, stable windows, gain margin and the frequency that limits
    the loop. For a law on the contact force it prints the loop in contact, and for a law that is
    not linear when its first force acts.
    """
    from hertzloop.studies.margin.contact import contact_margin, impact_facts
    from hertzloop.studies.margin.margin import margin_of
    from hertzloop.studies.margin.shown import contact_lines, fact_lines, margin_lines

    check_json(json_file)
    changes = list(settings or [])
    if law is not None:
        changes.insert(0, f"controller.law={law}")
    setup = scene_from(scene, changes, None)
    contact = facts = None
    try:
        found = margin_of(setup)
        if not found.applicable and setup.has_law and setup.scheme == "modal":
            analysed = contact_margin(setup)
            if isinstance(analysed, str):
                facts = impact_facts(setup)
            else:
                contact = analysed
    except SceneError as error:
        fail(str(error), 2)
    data: dict[str, Any] = asdict(found) | {
        "contact": None if contact is None else asdict(contact),
        "impact": None if facts is None else asdict(facts),
    }
    lines = margin_lines(found)
    lines += contact_lines(contact) if contact else fact_lines(facts) if facts else []
    for line in lines:
        out.print(line, soft_wrap=True)
    write_json(json_file, data)
