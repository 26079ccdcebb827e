"""First message of a run."""

import secrets
from functools import cache
from importlib.metadata import version
from json import dumps

from bus.messages_pb2 import Hello
from hertzloop.setup import Setup

_PACKAGES = ("hertzloop", "numpy", "numba", "eclipse-zenoh", "mcap", "protobuf")


@cache
def versions_here() -> str:
    """Versions of this package and of those that a run depends on: JSON, by package."""
    return dumps({name: version(name) for name in _PACKAGES})


def hello(setup: Setup, stiffness: float) -> Hello:
    """First message of a run."""
    return Hello(
        scene=setup.name,
        scene_toml=setup.toml,
        steps=setup.steps,
        step_ns=setup.step_ns,
        seed=setup.seed,
        stiffness=stiffness,
        versions=versions_here(),
        law=setup.law.name,
        law_digest=setup.law.digest,
        law_source=setup.law.source,
    )


def new_run_id() -> int:
    """Random, never zero."""
    return secrets.randbits(63) | 1
