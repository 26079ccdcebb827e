"""Scenes with other values of some keys, as in a sweep."""

from collections import defaultdict
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from hertzloop.controller.law import WHOLE_STEPS
from hertzloop.controller.loading.law import LawError
from hertzloop.controller.loading.registry import read_again, resolve
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.scene.attached_files import inline_files
from hertzloop.scene.controller_table import law_key, switch_law
from hertzloop.scene.errors import SceneError, table_at
from hertzloop.scene.loading import set_key, validate_scene
from hertzloop.scene.scene import Scene
from hertzloop.scene.tables import SceneTable
from hertzloop.scene.unused_keys import drop_unused_keys


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
    drop_unused_keys(data, values)
    if "controller.law" in values:
        try:
            name = resolve(str(values["controller.law"]))
            switch_law(data["controller"], name)
        except LawError as error:
            raise SceneError(str(error)) from error
        if "sensors.quantity" not in values:
            data["sensors"]["quantity"] = "auto"
    for key, value in values.items():
        set_key(data, key, value)
    inline_files(data, Path())
    found = validate_scene(data)
    if f"controller.{_DIGEST}" not in values:
        _found_as_in(scene.controller, found.controller)
    return found


def _by_tables(scene: Scene, values: Mapping[str, Any]) -> Scene | None:
    """The scene with tables that were checked before; None where that does not do."""
    tables = changed_tables(scene, values)
    if tables is None:
        return None
    found = scene.replaced(**tables)
    return None if found.problems() else found


@lru_cache(maxsize=64)
def _with_law(scene: Scene, law: str) -> Scene | None:
    """The scene under another shipped law; None if that does not fit it."""
    try:
        return vary(scene, {"controller.law": law})
    except SceneError:
        return None


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


_DIGEST = "law_digest"


def _found_as_in(table: SceneTable, changed: SceneTable) -> None:
    """Note in a changed table that its law's digest was found, not asked for, if so in `table`."""
    if _DIGEST not in table.model_fields_set:
        changed.model_fields_set.discard(_DIGEST)


def with_law_as_it_is(scene: Scene) -> Scene:
    """The scene with its law as that is now, read again. Raises SceneError for a law that changed,
    if the scene asks for one digest."""
    if scene.controller.law in shipped_laws():
        return scene
    read_again()
    data = _opened(scene, {"controller"})
    if _DIGEST not in scene.controller.model_fields_set:
        del data["controller"][_DIGEST]
    now = validate_scene(data)
    return scene if now.controller.law_digest == scene.controller.law_digest else now


def resolution_of(scene: Scene, key: str) -> float:
    """How far apart the values of "table.key" are: 1 of whole numbers, a step of the controller's
    times (us), 0 of any numbers and of what is no key."""
    *path, last = key.split(".")
    if path == ["controller"]:
        info = law_key(scene.controller, last)
        kind: Any = info.annotation if info else None
        if last in scene.controller.whole_step_keys or (info and WHOLE_STEPS in info.metadata):
            return scene.run.step_ns / 1000
    else:
        try:
            kind = table_at(tuple(path), Scene).model_fields[last].annotation
        except (KeyError, AttributeError):
            return 0.0
    kinds = {kind, *get_args(kind)}
    kinds |= {inner for outer in kinds for inner in get_args(outer)}
    return 1.0 if int in kinds else 0.0


_KEPT = 4096  # tables: the cases of a sweep give each the same few values again and again
# What other tables, or files, have a say in.
_NOT_ALONE = {
    "plate.modes",
    "sensors.quantity",
    "controller.law",
    "controller.law_digest",
    "controller.latency_trace",
    "controller.filter_file",
}


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
        changed = type(table).model_validate(given | dict(zip(names, values, strict=True)))
    except ValidationError:
        return None
    _found_as_in(table, changed)
    return changed
