"""Read a scene from TOML, with settings `key=value`."""

import difflib
import shlex
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hertzloop.common.missing_files import close_name, why_unreadable
from hertzloop.common.readable import argument
from hertzloop.common.text_files import text_of
from hertzloop.controller.loading.law import LawError
from hertzloop.controller.loading.registry import read_again, resolve
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.scene.attached_files import inline_files
from hertzloop.scene.controller_table import switch_law
from hertzloop.scene.errors import LONGEST, SceneError, sentence, shortened, shown
from hertzloop.scene.materials import expand_material
from hertzloop.scene.rules import BESIDE, IN_PLACE
from hertzloop.scene.scene import Scene
from hertzloop.scene.toml import parse_toml, toml_value

DEFAULT = "aluminium-20mm"


def shipped() -> list[str]:
    """Names of the scenes that come with hertzloop, the default first."""
    folder = resources.files("hertzloop") / "scene"
    names = [f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")]
    return sorted(names, key=lambda name: (name != DEFAULT, name))


def shipped_text(name: str) -> str:
    """The text of a shipped scene."""
    return (resources.files("hertzloop") / "scene" / f"{name}.toml").read_text("utf-8")


_DESCRIBED = {"sphere", "plate"}  # tables that the sentence `shows` speaks of
# Keys that have no effect once another is set.
_LOST = {
    "sphere.drop_height_m": ("sphere.speed_m_s",),
    "plate.material.loss_factor": ("plate.loss_factor",),
    **IN_PLACE,
}
_OF_LAWS = (".py", ".so", ".dylib", ".fmu")


def load(source: str, settings: Iterable[str] = (), seed: int | None = None) -> Scene:
    """Read a scene by shipped name or from a file, apply `key=value` settings and the seed.

    Files that it names are relative to its own folder, those that a setting names to the working
    directory. A law may be in either; a setting that names a file of both is refused. Raises
    SceneError with one sentence for anything wrong in it.
    """
    path = Path(source)
    if path.suffix in _OF_LAWS:
        raise SceneError(
            f"{shortened(source)}: is a law, not a scene. Use --set "
            f"{shortened(shlex.quote(f'controller.law={source}'))}."
        )
    if path.suffix == ".mcap":
        file = shortened(shlex.quote(argument(source)))
        raise SceneError(
            f"{shortened(source)}: is a recording, not a scene. To show it, run `hertzloop inspect "
            f"{file}`. To repeat it, run `hertzloop run --repeat {file}`."
        )
    text = _text(source)  # first: there may be no looking for it
    folder = path.parent if path.is_file() else None
    return parse(text, settings, seed, folder=folder, name=source)


def _text(source: str) -> str:
    path, names = Path(source), shipped()
    if source in names and path.is_file():
        raise SceneError(
            f"SCENE = '{source}': is a shipped scene and a file in the working folder. Write "
            f"./{source} for the file, or rename the file."
        )
    try:
        if path.suffix == ".toml" or path.is_file():
            return text_of(path.read_bytes())
    except (OSError, ValueError) as error:
        remedy = "'hertzloop scene list' names the shipped scenes, 'scene new' writes another."
        why = shortened(why_unreadable(path, error, remedy), LONGEST)
        raise SceneError(f"cannot read the scene {shortened(source)}: {why}") from error
    if source not in names:
        beside = close_name(path.with_name(f"{path.name}.toml")) if path.name else None
        close = difflib.get_close_matches(source, names, 1) or [*filter(None, [beside])]
        hint = f" Did you mean {close[0]}?" if close else ""
        raise SceneError(
            f"SCENE = {shown(source)}: unknown scene.{hint} Use one of {', '.join(names)}, "
            "or the path of a .toml file."
        )
    return shipped_text(source)


def parse(
    text: str,
    settings: Iterable[str] = (),
    seed: int | None = None,
    *,
    folder: Path | None = None,
    law: str | None = None,
    recorded: bool = False,
    name: str = "",
) -> Scene:
    """Make a scene from TOML text. Raises SceneError.

    The files that it names, its law's too, are looked for in `folder` and in the working folder;
    `law` says where the law is on this machine. A `recorded` scene need not find its law. `name`
    is what the text goes by. The law is read again, whatever was loaded before.
    """
    read_again()
    try:
        data = parse_toml(text)
    except ValueError as error:
        raise SceneError(
            f"the scene{name and ' ' + shortened(name)} is not valid TOML: {shortened(str(error))}"
        ) from error
    inline_files(data, folder or Path())
    values = dict(parse_setting(setting) for setting in settings)
    if seed is not None:
        values["run.seed"] = seed
    change(data, values, folder, written=True)
    if law is not None:
        set_key(data, "controller.law", law)
    return validate_scene(data, folder, recorded)


def validate_scene(
    data: dict[str, Any], folder: Path | None = None, recorded: bool = False
) -> Scene:
    control = data.get("controller")
    try:
        law = control.get("law") if isinstance(control, dict) else None
        if isinstance(control, dict) and isinstance(law, str) and law not in shipped_laws():
            data = {**data, "controller": {**control, "law": resolve(law, folder)}}
        return Scene.model_validate(data, context={"recorded": recorded})
    except ValidationError as error:
        raise SceneError(sentence(error, Scene)) from error


def change(
    data: dict[str, Any],
    values: Mapping[str, Any],
    folder: Path | None = None,
    written: bool = False,
) -> None:
    """Set keys "table.key" of a scene's tables, and drop what has no effect beside them any more.

    Args:
        data: the tables, as plain data.
        values: new values by scene key; files that they name are in the working folder.
        folder: folder of the scene, where a law's file may be as well.
        written: whether `data` has only what somebody wrote, none of the defaults.

    Raises:
        SceneError: a key or a file cannot be.
    """
    lost = {key for set_now in values for key in _LOST.get(set_now, ())}
    lost |= {
        key
        for key, (other, wanted) in BESIDE.items()
        if wanted is not None and values.get(other, wanted) != wanted
    }
    if values.get("contact.plasticity") == "none":
        lost.add("contact.limiting_pressure_pa")
    _drop(data, lost - values.keys())
    if {key.partition(".")[0] for key in values} & _DESCRIBED:
        data.pop("shows", None)  # it was written for other bodies
    law, table = values.get("controller.law"), data.get("controller", {})
    if isinstance(law, str) and isinstance(table, dict):
        try:
            switch_law(table, law, folder, written)
        except LawError as error:
            raise SceneError(shortened(str(error), LONGEST)) from error
    for key, value in values.items():
        set_key(data, key, value)
    inline_files(data, Path())


def _drop(data: dict[str, Any], keys: Iterable[str]) -> None:
    for key in keys:
        table, _, name = key.partition(".")
        if isinstance(data.get(table), dict):
            data[table].pop(name, None)


def parse_setting(setting: str) -> tuple[str, Any]:
    """Key and value of one key=value; the value is TOML, a bare word counts as text. Raises
    SceneError."""
    key, equals, value = setting.partition("=")
    if not equals or not all(key.strip().split(".")):
        raise SceneError(
            f"--set {shown(setting)}: invalid setting. Write table.key=value, as in "
            "sensors.bits=12."
        )
    return key.strip(), toml_value(value)


def set_key(data: dict[str, Any], key: str, value: Any) -> None:
    """Set table.key in nested tables."""
    path = key.split(".")
    table = data
    if path[1:2] == ["material"] and len(path) == 3:
        expand_material(data, path[0])
    for part in path[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise SceneError(
                f"{shown(key)}: unknown scene key; {shown(part)} is a value, not a table."
            )
    table[path[-1]] = value
