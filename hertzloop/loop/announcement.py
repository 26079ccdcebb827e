"""What plant and controller announce: scene, law and versions of a run."""

import json
from functools import cache
from importlib.metadata import version

from hertzloop.bus.messages_pb2 import (
    ControllerReport,
    Hello,
)
from hertzloop.common.version import __version__
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml

# Packages whose version may change a sample.
_PACKAGES = ("numpy", "numba", "eclipse-zenoh", "mcap", "protobuf")


@cache
def versions_here() -> str:
    """Return the versions of hertzloop and of the packages that a run depends on, as JSON."""
    return json.dumps({"hertzloop": __version__} | {name: version(name) for name in _PACKAGES})


def hello(setup: Setup, stiffness: float) -> Hello:
    """Return the first message of a run."""
    return Hello(
        scene=setup.scene.name,
        versions=versions_here(),
        scene_toml=to_toml(setup.scene, brief=True),
        steps=setup.run.steps,
        step_ns=setup.run.step_ns,
        seed=setup.run.seed,
        stiffness=stiffness,
        law=loaded_law(setup).name,
        law_digest=loaded_law(setup).digest,
    )


def controller_report(setup: Setup, law: str | None = None) -> ControllerReport:
    """Return what a controller states at its end: the scene and the law that it used.

    Args:
        setup: Setup of the controller.
        law: Name of the law in the plant's scene, if this side has its file elsewhere.
    """
    return ControllerReport(
        scene_toml=to_toml(setup.scene, law or setup.scene.controller.law, brief=True),
        stiffness=setup.law_context.stiffness,
        law=loaded_law(setup).name,
        law_digest=loaded_law(setup).digest,
        versions=versions_here(),
    )
