"""What decides cases and their bits: scenes, laws with their digests, versions of the code."""

import hashlib
import secrets
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from hertzloop.common.jit.folder import code_digest
from hertzloop.controller.loading.law import LawError
from hertzloop.controller.loading.registry import find, resolve, shipped
from hertzloop.scene.controller import law_constants
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml
from hertzloop.studies.cases.design import Design

_PACKAGES = ("hertzloop", "numpy", "numba")


def code_version() -> str:
    """What decides the bits of a result: versions, and the digest of all compiled kernels."""
    return ", ".join([*(f"{p} {version(p)}" for p in _PACKAGES), f"kernels {code_digest()}"])


def laws_of(setup: Setup, design: Design) -> dict[str, dict[str, str]]:
    """What decides the forces of every law of a sweep, by what the scene or the axis calls it:
    name, digest, text, and a digest of the constants that it prepares for the scene."""
    named = [setup.law_reference]
    named += [str(v) for axis in design.axes if axis.key == "controller.law" for v in axis.values]
    found = {}
    for reference in named:
        law = find(resolve(reference))
        digest = law.digest
        if law.identity_note():  # no earlier results are of this very law
            digest += secrets.token_hex(8)
        constants = "" if law.name in shipped() else _constants_digest(setup, reference)
        found[reference] = {
            "name": law.name,
            "digest": digest,
            "source": law.source,
            "constants": constants,
        }
    return found


def _constants_digest(setup: Setup, law: str) -> str:
    """Digest of the constants that a law prepares, perhaps from files; empty if it refuses the
    scene, which its cases say."""
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
    """What decides the cases of a search or a chart, and what comes of them, as far as all share
    it: scenes, laws with their digests, versions. The arguments of each come on top."""
    return {
        "scenes": [to_toml(setup.scene) for setup in scenes],
        "laws": [laws_of((scenes[0]).vary({"controller.law": law}), design) for law in laws],
        "versions": code_version(),
    }


def check_laws(header: dict[str, Any]) -> None:
    """Raises SceneError if a law is not any more what a sweep's results were made with."""
    for reference, about in header.get("laws", {}).items():
        try:
            find(resolve(reference), about["digest"])
        except LawError as error:
            raise SceneError(f"the results cannot be verified: {error}") from error
