"""The commands `hertzloop scene ...`: list, show, new, keys, check, modes."""

import re
import shlex
from pathlib import Path
from typing import Annotated

import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.terminal import fail, out
from hertzloop.common.atomic_files import atomic_write
from hertzloop.common.readable import argument
from hertzloop.scene import keys as all_keys
from hertzloop.scene.errors import shown
from hertzloop.scene.loading import DEFAULT, shipped, shipped_text
from hertzloop.scene.scene import possible_name
from hertzloop.scene.setup import load
from hertzloop.views.format import Table, print_all, unwrapped


def list_scenes() -> None:
    """List the shipped scenes.

    Each comes with one sentence on what it shows.
    """
    for one in shipped():
        note = " (default)" if one == DEFAULT else ""
        out.say(unwrapped((one, "bold"), f"{note}\n    {load(one).scene.shows}"))


def show(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of a shipped scene.")],
) -> None:
    """Print a shipped scene as TOML.

    Redirect the output to a file to start a scene of your own from it.
    """
    if name not in shipped():
        fail(f"NAME = {shown(name)}: unknown scene. Use one of {', '.join(shipped())}.")
    print(shipped_text(name), end="")


def new(
    file: Annotated[Path, typer.Argument(metavar="F.toml", help="Write this new file.")],
) -> None:
    """Write a commented scene that runs without changes."""
    then = shlex.join(["hertzloop", "run", argument(file)])
    outputs.write_new(file, (".toml",), "scene", lambda: {file: _start_of(file)}, then)


_HEADER = """# A scene for hertzloop: run it with   hertzloop run {name}
#
# Every key is in its table; a wrong one is refused with a sentence. What is left out has its
# default. `hertzloop run {name} --set sensors.bits=12` changes a key for one run.

"""


def _start_of(file: Path) -> str:
    """Return the text of a new scene: the default scene, with comments."""
    text = re.sub(r"^shows = .*\n", "", shipped_text(DEFAULT), flags=re.MULTILINE)
    name = f'name = "{possible_name(file.stem)}"  # of its recording, too'
    text = text.replace(f'name = "{DEFAULT}"', name)
    return _HEADER.format(name=shlex.quote(file.name)) + text


def keys(
    part: Annotated[str, typer.Argument(help="List only keys that contain this text.")] = "",
    law: Annotated[str | None, typer.Option(help="List the keys of this law only.")] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print a Markdown page.")] = False,
) -> None:
    """List the keys of a scene: values, unit, default, meaning."""
    if markdown:
        print(all_keys.page(), end="")
        return
    found = all_keys.keys() if law is None else all_keys.keys_of(law)
    chosen = [key for key in found if part in key.name]
    if part and not chosen:
        fail(f"PART = '{part}': no key contains it. List all keys with: hertzloop scene keys")
    table = Table("key", "value", "meaning")
    for key in chosen:
        table.add_row(key.name, all_keys.value_of(key), key.meaning)
    out.print(table)


def check(
    scene: options.SceneArgument = DEFAULT,
    settings: options.SetOption = None,
    seed: options.SeedOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """List the physical effects that a scene neglects, and the size of each.

    Every indicator comes with its threshold and formula.
    """
    resolved = prepare.scene_from(scene, settings, seed)
    outputs.check_json(json_file)
    prepare.compile_first(resolved)

    # 0.07 s, which the other commands save.
    from hertzloop.results.effects import neglected_of_scene
    from hertzloop.views.effects import neglected_lines, not_evaluated, table_of
    from hertzloop.views.run_json import effects_as_json

    neglected = neglected_of_scene(resolved)
    found = {"stable": neglected.stable, **effects_as_json(neglected)}
    if not neglected.stable:
        out.print("The closed loop is unstable; neglected effects are not evaluated.")
    elif not neglected.checks:
        out.print("No contact occurs within the run, so no effect is neglected.")
    else:
        print_all(out, [table_of(neglected.checks), *neglected_lines(neglected.checks)])
        if lacking := not_evaluated(neglected):
            out.say(lacking)
    outputs.write_json(json_file, {"scene": resolved.scene.name, **found})


def modes(
    scene: options.SceneArgument,
    out_file: Annotated[Path, typer.Option("--out", "-o", help="Write this .csv or .npz file.")],
    settings: options.SetOption = None,
    overwrite: options.OverwriteOption = False,
) -> None:
    """Write the modes of a scene's structure to a file.

    The key plate.modes of a scene reads this file.
    """
    from hertzloop.plant.structures.mode_file import SUFFIXES, write_modes
    from hertzloop.results.scene_modes import modes_of_scene

    if out_file.suffix not in SUFFIXES:
        fail(f"--out = {out_file}: unknown format. Use a name that ends in .csv or .npz.")
    setup = prepare.scene_from(scene, settings, None)
    read = outputs.files_of(setup, scene, *(settings or []))
    outputs.check_output(out_file, overwrite, read=read)
    table = modes_of_scene(setup)
    atomic_write(out_file, write_modes(out_file.suffix, table))
    out.say(
        f"{len(table.omega_rad_s)} modes (modes of equal frequency merged, modes without "
        f"participation dropped), and a residual flexibility of "
        f"{table.residual_flexibility_m_n:.4g} m/N; written: {out_file}"
    )
