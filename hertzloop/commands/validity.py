"""The commands `validity`, all that a scene leaves out, with its size, and `chart validity`."""

from pathlib import Path
from typing import Annotated

import typer

from hertzloop.commands.options import (
    JsonOption,
    SceneArgument,
    SeedOption,
    SetOption,
    check_json,
    compile_first,
    make_folder,
    scene_from,
    write_json,
)
from hertzloop.commands.terminal import fail, out
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import DEFAULT


def validity(
    scene: SceneArgument = DEFAULT,
    settings: SetOption = None,
    seed: SeedOption = None,
    json_file: JsonOption = None,
) -> None:
    """What a scene leaves out, every indicator with its size, threshold and formula."""

    resolved = scene_from(scene, settings, seed)
    check_json(json_file)
    compile_first(resolved)

    from hertzloop.analysis.validity import State, neglected_of_scene
    from hertzloop.views.effects import effects_as_json, show_left_out, table_of

    try:
        neglected = neglected_of_scene(resolved)
    except SceneError as error:
        fail(str(error), 2)
    found = {"stable": neglected.stable, **effects_as_json(neglected)}
    if not neglected.stable:
        out.print("The closed loop is unstable: what else it leaves out would say nothing.")
    elif not found["validity"]:
        out.print("No contact within the run, so nothing is left out of one.")
    else:
        out.print(table_of(found["validity"]))
        show_left_out(out, found["validity"])
        for finding in found["validity"]:
            if finding["state"] == State.NOT_KNOWN:
                out.print(f"Not known: {finding['sentence']}.", soft_wrap=True)
    write_json(json_file, {"scene": resolved.name, **found})


def validity_map(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for picture and numbers.")],
    scene: SceneArgument = DEFAULT,
    settings: SetOption = None,
) -> None:
    """Which theory and effects matter, over radius and thickness, for a scene's materials."""
    from studies import validity as study

    resolved = scene_from(scene, settings, None)
    make_folder(folder)
    try:
        sizes = study.run(resolved, folder)
    except SceneError as error:
        fail(str(error), 2)
    except OSError as error:
        fail(f"cannot write into {folder}: {error.strerror}", 1)
    for name, size in sizes.items():
        shares = (f"{100.0 * (size > level).mean():.0f} %" for level in (1e-3, 1e-1))
        out.print("{}: above 0.1 % in {} of the map, above 10 % in {}".format(name, *shares))
    out.print(f"written: {folder}/validity.png and .csv", soft_wrap=True)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(validity)
