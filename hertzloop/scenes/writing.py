"""A scene as text: what goes into the recording, and to other processes."""

from typing import TYPE_CHECKING

import tomli_w

if TYPE_CHECKING:
    from hertzloop.scenes.scene import Scene


def to_toml(scene: "Scene", law: str | None = None) -> str:
    """Return a scene as TOML, every key written out; `law`: another reference to the same law."""
    tables = scene.model_dump(exclude_none=True)
    if law is not None:
        tables["controller"]["law"] = law
    return tomli_w.dumps(tables)
