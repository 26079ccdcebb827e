"""First message of a run."""

import secrets
from functools import cache
from importlib.metadata import version
from json import dumps

from bus.messages_pb2 import Hello
from hertzloop.scenes.scene import Scene, to_toml

_PACKAGES = ("hertzloop", "numpy", "numba", "eclipse-zenoh", "mcap", "protobuf")


@cache
def versions_here() -> str:
    """Versions of this package and of those that a run depends on: JSON, by package."""
    return dumps({name: version(name) for name in _PACKAGES})


def hello(scene: Scene, stiffness: float) -> Hello:
    """First message of a run."""
    return Hello(
        scene=scene.name,
        scene_toml=to_toml(scene),
        steps=scene.steps,
        step_ns=scene.run.step_ns,
        seed=scene.run.seed,
        stiffness=stiffness,
        versions=versions_here(),
        law=scene.law.name,
        law_digest=scene.law.digest,
        law_source=scene.law.source,
    )


def new_run_id() -> int:
    """Random, never zero."""
    return secrets.randbits(63) | 1
