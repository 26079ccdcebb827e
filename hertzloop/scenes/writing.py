"""A scene as text: what goes into the recording, and to other processes."""

from typing import TYPE_CHECKING

import tomli_w

if TYPE_CHECKING:
    from hertzloop.scenes.scene import Scene


def to_toml(scene: "Scene", law: str | None = None, brief: bool = False) -> str:
    """Return a scene as TOML, every key written out; `law`: another reference to the same law;
    `brief`: without what files of modes and of latencies hold."""
    tables = scene.model_dump(exclude_none=True)
    if brief:
        tables["plate"].get("modes", {}).pop("content", None)
        tables["controller"].pop("latency_trace", None)
    if law is not None:
        tables["controller"]["law"] = law
    return tomli_w.dumps(tables)
