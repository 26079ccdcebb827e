"""Scenes with other values of some keys, as in a sweep."""

from collections.abc import Mapping
from typing import Any

from hertzloop.controller.law import WHOLE_STEPS
from hertzloop.controller.loading.registry import read_again
from hertzloop.scene.controller_table import law_key
from hertzloop.scene.fields import fields_at, parts_of
from hertzloop.scene.loading import change, validate_scene
from hertzloop.scene.scene import Scene

_DIGEST = "law_digest"


def vary(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """Return a scene with other values.

    Args:
        scene: the scene, which stays as it is.
        values: new values by scene key, for example {"sphere.radius_m": 0.004}.

    Raises:
        SceneError: a key is unknown, or a value is not possible.
    """
    data = _opened(scene, {key.split(".")[0] for key in values})
    if "controller.law" in values:
        data["sensors"]["quantity"] = "auto"
    change(data, values)
    found = validate_scene(data)
    if f"controller.{_DIGEST}" not in values and _DIGEST not in scene.controller.model_fields_set:
        found.controller.model_fields_set.discard(_DIGEST)  # it was found, not asked for
    return found


_READ_TOGETHER = {"sensors", "controller"}  # the one may have to name what the other works on


def _opened(scene: Scene, changed: set[str]) -> dict[str, Any]:
    """A scene's tables: those `changed` as plain data, the others as they are, which were checked
    once. Own materials are plain data too: a changed table may go back to their numbers."""
    if changed & _READ_TOGETHER:
        changed = changed | _READ_TOGETHER
    if "materials" in changed:  # by name in other tables
        changed = set(Scene.model_fields)
    data = {name: value for name, value in scene if name not in changed and value is not None}
    plain = scene.model_dump(include=changed | {"materials"}, exclude_none=True, exclude_unset=True)
    if "controller" in changed and scene.controller.law_digest is not None:
        plain.setdefault("controller", {})[_DIGEST] = scene.controller.law_digest
    return data | plain


def with_law_as_it_is(scene: Scene) -> Scene:
    """The scene with its law as that is now, read again. Raises SceneError for a law that changed,
    if the scene asks for one digest."""
    if scene.controller.law_is_shipped:
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
            return scene.run.step_us
    else:
        try:
            kind = fields_at(path, Scene)[last].annotation
        except KeyError:
            return 0.0
    return 1.0 if any(one is int for one in parts_of(kind)) else 0.0
