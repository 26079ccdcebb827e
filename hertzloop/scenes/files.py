"""What a scene says by the name of a file: materials and modes, taken into the scene itself.

After that the scene needs no file any more: every process, the recording and whoever runs it again
have the very numbers.
"""

import base64
import binascii
import hashlib
import zlib
from pathlib import Path
from typing import Any

from hertzloop.scenes.errors import shortened
from plant.structures.materials import SHIPPED, materials_of
from plant.structures.mode_file import SUFFIXES, read_modes

_MOST_BYTES = 64 << 20  # of a file of modes, unpacked
_MOST_PACKED = 8 << 20  # in a scene, and so in one message on the bus


def take_in(data: dict[str, Any], folder: Path) -> None:
    """Put files named in a scene's tables in their place; names are relative to `folder`.

    Raises ValueError with one sentence.
    """
    if isinstance(data.get("materials"), str):
        data["materials"] = _materials(folder / data["materials"])
    plate = data.get("plate")
    if isinstance(plate, dict) and isinstance(plate.get("modes"), str):
        plate["modes"] = _modes(folder / plate["modes"])


def open_material(data: dict[str, Any], body: str) -> None:
    """Put a material's numbers in the place of its name, so that one of them can be changed."""
    table = data.get(body)
    name = table.get("material") if isinstance(table, dict) else None
    if not isinstance(table, dict) or not isinstance(name, str):
        return
    materials = data.get("materials")
    for own in materials if isinstance(materials, list | tuple) else ():
        if isinstance(own, dict) and own.get("name") == name:
            table["material"] = dict(own)
            return
    if name in SHIPPED:
        table["material"] = {"name": name, **SHIPPED[name]}


def _echoed(path: Path) -> str:
    """A file's path as a sentence has it."""
    return shortened(repr(str(path)))


def _materials(path: Path) -> list[dict[str, object]]:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise ValueError(
            f"materials = {_echoed(path)} cannot be read: {shortened(str(error))}"
        ) from error
    return [{"name": name, **table} for name, table in materials_of(text, str(path)).items()]


def _modes(path: Path) -> dict[str, str]:
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(
            f"plate.modes = {_echoed(path)} is none of {', '.join(SUFFIXES)}, which a file of "
            "modes can be"
        )
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise ValueError(f"plate.modes = {_echoed(path)} cannot be read: {why}") from error
    read_modes(path.name, content)
    packed = base64.b64encode(zlib.compress(content, 9)).decode("ascii")
    if len(packed) > _MOST_PACKED:
        raise ValueError(
            f"plate.modes = {_echoed(path)} takes {len(packed) / 1e6:.3g} MB in a recording, the "
            f"most is {_MOST_PACKED / 1e6:.3g}; take fewer modes, or a coarser grid"
        )
    return {
        "file": path.name,
        "sha256": hashlib.sha256(content).hexdigest(),
        "content": packed,
    }


def unpacked(file: str, sha256: str, content: str) -> bytes:
    """The bytes of a file of modes as a scene holds it. Raises ValueError if they are damaged."""
    try:
        opener = zlib.decompressobj()
        found = opener.decompress(base64.b64decode(content, validate=True), _MOST_BYTES)
    except (binascii.Error, zlib.error) as error:
        raise ValueError(f"plate.modes.content of {file} is damaged: {error}") from error
    if hashlib.sha256(found).hexdigest() != sha256:
        raise ValueError(f"plate.modes.content of {file} is not what plate.modes.sha256 says")
    return found
