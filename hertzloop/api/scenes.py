"""Scenes for scripts: load, vary and resolve them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hertzloop.api.parameters import with_parameter_names
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import load as load_scene
from hertzloop.scene.loading import shipped
from hertzloop.scene.scene import Scene
from hertzloop.scene.setup import Setup, resolve
from hertzloop.scene.varying import vary as vary_scene
from hertzloop.scene.varying import with_law_as_it_is

AnyScene = Scene | str | Path  # a scene, the name of a shipped one, or a TOML file


def scene_names() -> list[str]:
    """Return the names of the shipped scenes."""
    return shipped()


@with_parameter_names
def load(source: str | Path, changes: Mapping[str, Any] | None = None) -> Scene:
    """Load a scene.

    Args:
        source: name of a shipped scene, or a TOML file.
        changes: values by scene key, for example {"controller.latency_us": 5}.

    Returns:
        The scene, checked.

    Raises:
        SceneError: the file cannot be read, or a key or a value is wrong.
    """
    scene = load_scene(str(source))
    return vary_scene(scene, changes) if changes else scene


@with_parameter_names
def vary(scene: AnyScene, values: Mapping[str, Any]) -> Scene:
    """Return a scene with other values.

    Args:
        scene: the scene, which stays as it is; or its name or TOML file.
        values: new values by scene key, for example {"sphere.radius_m": 0.004}.

    Raises:
        SceneError: a key is unknown, or a value is not possible.
    """
    try:
        now = current(scene)
    except SceneError:
        if not isinstance(scene, Scene) or "controller.law" not in values:
            raise
        now = scene  # a recording's, whose law is not needed
    return vary_scene(now, values)


def current(scene: AnyScene) -> Scene:
    """Return a scene whose law is read again from its file. Raises SceneError."""
    return with_law_as_it_is(scene) if isinstance(scene, Scene) else load(scene)


def resolved(scene: AnyScene) -> Setup:
    """Return the setup of a scene whose law is read again from its file. Raises SceneError."""
    from hertzloop.processes.law_trial import check_repeatable  # only a law of the user needs it

    setup = resolve(current(scene))
    if not setup.scene.controller.law_is_shipped:
        check_repeatable(setup)
    return setup
