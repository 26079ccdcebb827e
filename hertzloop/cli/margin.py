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
    the loop.
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
    for line in margin_lines(found):
        out.print(line, soft_wrap=True)
    write_json(json_file, data)
