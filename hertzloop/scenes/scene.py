"""Scenes: what is simulated, as one TOML file, checked before anything runs."""

import copy
import difflib
import re
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tomli_w
from pydantic import BaseModel, Field, ValidationError, ValidationInfo, model_validator

from hertzloop.controller.law import WHOLE_STEPS
from hertzloop.controller.loading.law import Law, LawError
from hertzloop.controller.loading.registry import find, resolve
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.plant.structures.materials import MATERIALS, Material
from hertzloop.scenes.controller_table import (
    ControllerTable,
    is_recorded,
    law_key,
    switch_law,
)
from hertzloop.scenes.errors import (
    LONGEST,
    NO_CASE_OF_THESIS,
    SceneError,
    sentence,
    shortened,
    shown,
    table_of,
)
from hertzloop.scenes.materials import (
    MaterialTable,
    SceneTable,
    check_materials,
    material_called,
    open_material,
    take_in,
)
from hertzloop.scenes.problems import drop_unread, problems
from hertzloop.scenes.quantities import SENSED
from hertzloop.scenes.tables import (
    ActuatorTable,
    ContactTable,
    FitTable,
    HammerTable,
    PlateTable,
    RunTable,
    SensorsTable,
    SphereTable,
    Striker,
)

DEFAULT = "aluminium-20mm"


def shipped() -> list[str]:
    """Names of the scenes that come with hertzloop, the default first."""
    folder = resources.files("hertzloop") / "scenes"
    names = [f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")]
    return sorted(names, key=lambda name: (name != DEFAULT, name))


def shipped_text(name: str) -> str:
    """The text of a shipped scene."""
    return (resources.files("hertzloop") / "scenes" / f"{name}.toml").read_text("utf-8")


def from_toml(text: str) -> dict[str, Any]:
    """TOML as plain data. Raises ValueError for whatever it cannot be, whatever the reason."""
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("its tables or lists are nested too deeply") from error


def toml_value(text: str) -> Any:
    """A value as written in TOML; a bare word counts as text."""
    try:
        return from_toml(f"value = {text}")["value"]
    except ValueError:
        return text.strip()


def toml_text(value: Any) -> str:
    """A value as written in TOML: what `toml_value` reads."""
    return tomli_w.dumps({"value": value}).removeprefix("value = ").strip()


__all__ = [
    "DEFAULT", "NO_CASE_OF_THESIS", "ControllerTable", "RunTable", "Scene", "SceneError",
    "SensorsTable", "grain_of", "load", "parse", "shipped", "shipped_text", "to_toml", "toml_text",
    "toml_value", "vary",
]  # fmt: skip


class Scene(SceneTable):
    """A scene: one table per part, as in the TOML file. `load` and `vary` make it.

    `scene.controller.latency_us` reads a key. The page of scene keys lists all of them.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=80)]
    """of the scene, and of its recording"""
    shows: str = ""
    """what it is for, in a sentence"""
    materials: tuple[MaterialTable, ...] | None = None  # by name, beside those that come with it
    """a file of materials, or a list, beside those that come with it"""
    sphere: SphereTable | None = None
    hammer: HammerTable | None = None
    plate: PlateTable
    contact: ContactTable = ContactTable()
    sensors: SensorsTable = SensorsTable()
    controller: ControllerTable = ControllerTable()
    actuator: ActuatorTable = ActuatorTable()
    run: RunTable
    fit: FitTable | None = None
    """where fitted values come from"""

    @property
    def striker(self) -> Striker:
        """The table of what strikes the plate; a scene has one."""
        found = self.sphere or self.hammer
        assert found is not None
        return found

    @property
    def step_s(self) -> float:
        """Length of a step, s."""
        return self.run.step_s

    @property
    def steps(self) -> int:
        """Length of the run in steps."""
        return self.run.steps

    def material(self, body: Literal["plate", "sphere"]) -> Material:
        """The material of the plate, or of the sphere or the hammer's tip."""
        given = self.plate.material if body == "plate" else self.striker.material
        return material_called(given, self.materials or ())

    def without_control(self) -> "Scene":
        """The same scene with the law switched off."""
        return self.replaced(controller=_switched_off(self.controller))

    @property
    def law(self) -> Law:
        """The law. Raises SceneError."""
        try:
            return self.controller.found
        except LawError as error:
            raise SceneError(str(error)) from error

    def whole_step_keys(self) -> list[str]:
        """Keys of the controller that have to be a whole number of steps."""
        return ["latency_us", "jitter_us", *self.law.whole_steps]

    @model_validator(mode="before")
    @classmethod
    def _name_the_quantity(cls, data: Any) -> Any:
        """Put what the law works on in the place of sensors.quantity = "auto"."""
        if not isinstance(data, dict):
            return data
        sensors, control = data.get("sensors", {}), data.get("controller", {})
        if not isinstance(sensors, dict) or not isinstance(control, dict):
            return data
        if sensors.get("quantity", "auto") != "auto":
            return data
        try:
            senses = find(
                str(control.get("law", "slope_threshold")), control.get("law_digest")
            ).senses
        except LawError:  # the table of the controller says so
            senses = "xi"
        senses = senses.partition(",")[0]  # the default of several
        if senses not in (*SENSED, "any"):  # see problems()
            senses = "xi"
        return {**data, "sensors": {**sensors, "quantity": senses.replace("any", "xi")}}

    @model_validator(mode="before")
    @classmethod
    def _materials_are_known(cls, data: Any) -> Any:
        if isinstance(data, dict):
            check_materials(data)
        return data

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> "Scene":
        for problem in [] if is_recorded(info) else problems(self):
            raise ValueError(problem)
        return self


_OF_LAWS = (".py", ".so", ".dylib", ".fmu")


def load(source: str, settings: Iterable[str] = (), seed: int | None = None) -> Scene:
    """Read a scene by shipped name or from a file, apply `key=value` settings and the seed.

    Files that it names are relative to its own folder, those that a setting names to the working
    directory. Raises SceneError with one sentence for anything wrong in it.
    """
    path = Path(source)
    if path.suffix in _OF_LAWS:
        raise SceneError(
            f"{shortened(source)}: is a law, not a scene. Use --set "
            f"controller.law={shortened(source)}."
        )
    if path.suffix == ".mcap":
        raise SceneError(
            f"{shortened(source)}: is a recording, not a scene. To show it, run `hertzloop inspect "
            f"{shortened(source)}`. To repeat it, run `hertzloop run --repeat {shortened(source)}`."
        )
    text = _text(source)  # first: there may be no looking for it
    folder = path.parent if path.is_file() else None
    return parse(text, settings, seed, folder=folder, name=source)


def _text(source: str) -> str:
    path = Path(source)
    try:
        if path.suffix == ".toml" or path.is_file():
            return path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise SceneError(
            f"cannot read the scene {shortened(source)}: {shortened(str(error))}"
        ) from error
    names = shipped()
    if source not in names:
        close = difflib.get_close_matches(source, names, 1)
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
    is what the text goes by.
    """
    try:
        data = from_toml(text)
    except ValueError as error:
        raise SceneError(
            f"the scene{name and ' ' + shortened(name)} is not valid TOML: {shortened(str(error))}"
        ) from error
    _take_in(data, folder or Path())
    before = copy.deepcopy(data)
    pairs = [_setting(text) for text in settings]
    _switch(data, dict(pairs), folder)
    for key, value in pairs:
        _put(data, key, value)
    _take_in(data, Path())
    relabel(before, data)
    if seed is not None:
        _put(data, "run.seed", seed)
    if law is not None:
        _put(data, "controller.law", law)
    return _checked(data, folder, recorded)


def on_modes(source: str, settings: Iterable[str], modes: str, name: str) -> dict[str, Any]:
    """Tables of a scene with a file of modes in the place of its plate.

    Args:
        source: a shipped scene, or a file. Of its plate, the material stays.
        settings: `key=value`, set after that.
        modes: name of the file of modes, beside the new scene.
        name: name of the new scene.

    Raises:
        SceneError: there is no such scene, or a setting is wrong.
    """
    path = Path(source)
    folder = path.parent if path.is_file() else Path()
    data = from_toml(_text(source))
    plate = data.get("plate")
    material = plate.get("material") if isinstance(plate, dict) else None
    data["plate"] = {"material": material} if material else {}
    _take_in(data, folder)
    pairs = [_setting(text) for text in settings]
    _switch(data, dict(pairs), folder)
    for key, value in pairs:
        _put(data, key, value)
    data["plate"]["modes"], data["name"] = modes, name
    return {key: data[key] for key in ("name", *data)}


def vary(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """Return a scene with other values.

    Args:
        scene: the scene, which stays as it is.
        values: new values by scene key, for example {"sphere.radius_m": 0.004}.

    Raises:
        SceneError: a key is unknown, or a value is not possible.
    """
    found = _by_tables(scene, values)
    if found is not None:
        return found
    law = values.get("controller.law")
    if len(values) > 1 and law in shipped_laws():
        # The cases of a sweep name the same few laws again and again.
        with_law = _with_law(scene, law)
        others = {key: value for key, value in values.items() if key != "controller.law"}
        found = None if with_law is None else _by_tables(with_law, others)
        if found is not None:
            return found
    data = _opened(scene, {key.split(".")[0] for key in values})
    drop_unread(data, values)
    if "controller.law" in values:
        try:
            name = resolve(str(values["controller.law"]))
            switch_law(data["controller"], name)
        except LawError as error:
            raise SceneError(str(error)) from error
        if "sensors.quantity" not in values:
            data["sensors"]["quantity"] = "auto"
    for key, value in values.items():
        _put(data, key, value)
    _take_in(data, Path())
    return _checked(data)


def _by_tables(scene: Scene, values: Mapping[str, Any]) -> Scene | None:
    """The scene with tables that were checked before; None where that does not do."""
    tables = changed_tables(scene, values)
    if tables is None:
        return None
    found = scene.replaced(**tables)
    return None if problems(found) else found


@lru_cache(maxsize=64)
def _with_law(scene: Scene, law: str) -> Scene | None:
    """The scene under another shipped law; None if that does not fit it."""
    try:
        return vary(scene, {"controller.law": law})
    except SceneError:
        return None


@lru_cache(maxsize=64)
def _switched_off(table: ControllerTable) -> ControllerTable:
    return table.switched_off()


_READ_TOGETHER = {"sensors", "controller"}  # the one may have to name what the other works on


def _opened(scene: Scene, changed: set[str]) -> dict[str, Any]:
    """A scene's tables: those `changed` as plain data, the others as they are, which were checked
    once. Own materials are plain data too: a changed table may go back to their numbers."""
    if changed & _READ_TOGETHER:
        changed = changed | _READ_TOGETHER
    if "materials" in changed:  # by name in other tables
        changed = set(Scene.model_fields)
    data = {name: value for name, value in scene if name not in changed and value is not None}
    return data | scene.model_dump(include=changed | {"materials"}, exclude_none=True)


def _take_in(data: dict[str, Any], folder: Path) -> None:
    try:
        take_in(data, folder)
    except ValueError as error:
        raise SceneError(shortened(str(error), LONGEST)) from error


def _checked(data: dict[str, Any], folder: Path | None = None, recorded: bool = False) -> Scene:
    control = data.get("controller")
    try:
        if isinstance(control, dict) and isinstance(control.get("law"), str):
            data = {**data, "controller": {**control, "law": resolve(control["law"], folder)}}
        return Scene.model_validate(data, context={"recorded": recorded})
    except LawError as error:
        raise SceneError(str(error)) from error
    except ValidationError as error:
        raise SceneError(sentence(error, Scene)) from error


def _switch(data: dict[str, Any], settings: Mapping[str, Any], folder: Path | None) -> None:
    """Drop keys of a file that have no effect any more once settings choose otherwise."""
    drop_unread(data, settings)
    law, table = settings.get("controller.law"), data.get("controller")
    if isinstance(law, str) and isinstance(table, dict):
        with suppress(LawError):  # the check of the table says so
            if isinstance(table.get("law"), str):
                table["law"] = resolve(table["law"], folder)
            switch_law(table, resolve(law), written=True)


def _setting(setting: str) -> tuple[str, Any]:
    """Key and value of one key=value; the value is TOML, a bare word counts as text."""
    key, equals, value = setting.partition("=")
    if not equals or not all(key.strip().split(".")):
        raise SceneError(
            f"--set {shown(setting)}: invalid setting. Write table.key=value, as in "
            "sensors.bits=12."
        )
    return key.strip(), toml_value(value)


def _put(data: dict[str, Any], key: str, value: Any) -> None:
    """Set table.key in nested tables."""
    path = key.split(".")
    table = data
    if path[1:2] in (["material"], ["tip_material"]) and len(path) == 3:
        open_material(data, path[0], path[1])
    for part in path[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise SceneError(
                f"{shown(key)}: unknown scene key; {shown(part)} is a value, not a table."
            )
    table[path[-1]] = value


def grain_of(scene: Scene, key: str) -> float:
    """How far apart the values of "table.key" are: 1 of whole numbers, a step of the controller's
    times (us), 0 of any numbers and of what is no key."""
    *path, last = key.split(".")
    if path == ["controller"]:
        info = law_key(scene.controller, last)
        kind: Any = info.annotation if info else None
        if last in scene.whole_step_keys() or (info and WHOLE_STEPS in info.metadata):
            return scene.run.step_ns / 1000
    else:
        try:
            model: Any = Scene
            for part in path:
                model = table_of(model.model_fields[part].annotation)
            kind = model.model_fields[last].annotation
        except (KeyError, AttributeError):
            return 0.0
    kinds = {kind, *get_args(kind)}
    kinds |= {inner for outer in kinds for inner in get_args(outer)}
    return 1.0 if int in kinds else 0.0


def to_toml(scene: Scene) -> str:
    """The scene as TOML, every key written out: what goes into the recording."""
    return tomli_w.dumps(scene.model_dump(exclude_none=True))


_KEPT = 4096  # tables: the cases of a sweep give each the same few values again and again
# What other tables, or files, have a say in.
_NOT_ALONE = {
    "plate.modes", "sensors.quantity", "controller.law", "controller.law_digest",
    "controller.latency_trace", "controller.filter_file",
}  # fmt: skip


def changed_tables(scene: BaseModel, values: Mapping[str, Any]) -> dict[str, SceneTable] | None:
    """The tables that hold the keys "table.key" of `values`, with these; None where that takes
    more than these tables, or one of them does not allow it."""
    by_table: dict[str, dict[str, Any]] = defaultdict(dict)
    for key, value in values.items():
        name, dot, last = key.partition(".")
        if key in _NOT_ALONE or not dot or "." in last:
            return None
        if last == "material" and not (isinstance(value, str) and value in MATERIALS):
            return None  # one of the scene's own, or unknown
        by_table[name][last] = value
    found = {}
    for name, changes in by_table.items():
        table = getattr(scene, name, None)
        if not isinstance(table, SceneTable):
            return None
        try:
            changed = _changed(table, tuple(changes), *changes.values())
        except TypeError:  # a list cannot be looked up
            return None
        if changed is None:
            return None
        found[name] = changed
    return found


@lru_cache(maxsize=_KEPT, typed=True)  # True is no 1
def _changed(table: SceneTable, names: tuple[str, ...], *values: Any) -> SceneTable | None:
    given = vars(table) | (table.__pydantic_extra__ or {})
    try:
        return type(table).model_validate(given | dict(zip(names, values, strict=True)))
    except ValidationError:
        return None


_LONGEST = 80


def relabel(before: dict[str, Any], after: dict[str, Any]) -> None:
    """Give the scene `after` its settings a name that fits, unless they name it themselves.

    "aluminium-3mm" with plate.material = "titanium" is "titanium-3mm"; what it is said to show
    is left out, as it was written for another.
    """
    if not isinstance(before.get("name"), str) or after.get("name") != before["name"]:
        return
    name = before["name"]
    for old, new in (
        (_material(before, "plate"), _material(after, "plate")),
        (_radius(before), _radius(after)),
        (_material(before, "sphere"), _material(after, "sphere")),
        (_value(before, "plate", "edges"), _value(after, "plate", "edges")),
        (_file(before), _file(after)),
    ):
        if new and new != old:
            name = _with(name, old, new)
    if name == before["name"] and _thickness(before) == _thickness(after):
        return
    after["name"] = re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-_.")[:_LONGEST]
    after.pop("shows", None)


def _with(name: str, old: str, new: str) -> str:
    """The name with a word exchanged, or one more."""
    words = name.split("-")
    if old in words:
        return "-".join(new if word == old else word for word in words)
    return f"{name}-{new}"


def _value(scene: dict[str, Any], table: str, key: str) -> Any:
    found = scene.get(table)
    return found.get(key) if isinstance(found, dict) else None


def _thickness(scene: dict[str, Any]) -> Any:
    return _value(scene, "plate", "thickness_m")


def _material(scene: dict[str, Any], body: str) -> str:
    """A material's name; numbers that are none of a name's count as another material."""
    found = _value(scene, body, "material")
    if isinstance(found, dict):
        return f"own-{found.get('name') or 'material'}"
    return str(found or "")


def _radius(scene: dict[str, Any]) -> str:
    if isinstance(scene.get("hammer"), dict):
        return "hammer"
    found = _value(scene, "sphere", "radius_m")
    if not isinstance(found, int | float) or isinstance(found, bool):
        return ""
    try:
        return f"{1e3 * found:g}mm"
    except OverflowError:  # a whole number beyond all radii, which is refused later
        return ""


def _file(scene: dict[str, Any]) -> str:
    found = _value(scene, "plate", "modes")
    return str(found.get("file", "")).rpartition(".")[0] if isinstance(found, dict) else ""
