"""The command that states the linear margin of a scene's loop."""

from dataclasses import asdict
from typing import Any

import typer

from hertzloop.cli.options import (
    JsonOption,
    SceneArgument,
    SetOption,
    check_json,
    fail,
    out,
    scene_from,
    write_json,
)
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import DEFAULT


def margin(
    scene: SceneArgument = DEFAULT,
    law: str | None = typer.Option(None, "--law", help="Use this law instead of the scene's."),
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """State whether the linear loop is stable in flight, and its latency and gain limits.

    Example: hertzloop margin aluminium-3mm --law velocity_feedback --set sensors.quantity=v_p
    """
    from hertzloop.studies.margin.margin import margin_of
    from hertzloop.studies.margin.shown import margin_lines

    check_json(json_file)
    changes = list(settings or [])
    if law is not None:
        changes.insert(0, f"controller.law={law}")
    setup = scene_from(scene, changes, None)
    try:
        found = margin_of(setup)
    except SceneError as error:
        fail(str(error), 2)
    data: dict[str, Any] = asdict(found)
    if str(json_file) != "-":
        for line in margin_lines(found):
            out.print(line, soft_wrap=True, markup=False, highlight=False)
    write_json(json_file, data)
