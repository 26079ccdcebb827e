"""What decides cases and their bits: scenes, laws with their digests, versions of the code."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from hertzloop.common.jit.folder import code_digest
from hertzloop.common.version import __version__
from hertzloop.controller.loading.registry import find, resolve, shipped
from hertzloop.scene.controller import law_constants
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml
from hertzloop.studies.cases.design import Design

_PACKAGES = ("numpy", "numba")


def code_version() -> str:
    """Return the versions and the digest of all compiled kernels, which decide the bits."""
    packages = (f"{package} {version(package)}" for package in _PACKAGES)
    return ", ".join([f"hertzloop {__version__}", *packages, f"kernels {code_digest()}"])


def laws_of(setup: Setup, design: Design) -> dict[str, dict[str, str]]:
    """Return what decides the forces of every law of a design, by the name in the scene or axis.

    That is the law's name, digest and text, and a digest of the constants that it prepares.
    """
    named = [setup.scene.controller.law]
    named += [str(v) for axis in design.axes if axis.key == "controller.law" for v in axis.values]
    found = {}
    for reference in named:
        law = find(resolve(reference))
        constants = "" if law.name in shipped() else _constants_digest(setup, reference)
        found[reference] = {
            "name": law.name,
            "digest": law.digest,
            "source": law.source,
            "constants": constants,
        }
    return found


def _constants_digest(setup: Setup, law: str) -> str:
    """Return a digest of the constants that a law prepares, perhaps from files; empty if it refuses
    the scene. Its cases then say so."""
    try:
        found = law_constants(setup.vary({"controller.law": law}))
    except SceneError:
        return ""
    values = found.values() if isinstance(found, Mapping) else found
    digest = hashlib.sha256()
    for value in values:
        digest.update(np.asarray(value, float).tobytes())
    return digest.hexdigest()[:16]


def work_of(scenes: Sequence[Setup], laws: Iterable[str], design: Design) -> dict[str, Any]:
    """Return what decides the cases of any study: scenes, laws with their digests, versions.

    The header of a journal is this and the request of the study.
    """
    return {
        "scenes": [to_toml(setup.scene) for setup in scenes],
        "laws": {
            reference: about
            for law in laws
            for reference, about in laws_of(scenes[0].vary({"controller.law": law}), design).items()
        },
        "versions": code_version(),
    }
