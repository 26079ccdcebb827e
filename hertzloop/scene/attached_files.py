"""Files that a scene names: materials, modes and latencies are copied into the scene itself.

After that the scene needs no file. Every process, the recording and a repetition have the same
numbers.
"""

import base64
import binascii
import hashlib
import zlib
from pathlib import Path
from typing import Any

from hertzloop.common.missing_files import told_if_unreadable
from hertzloop.controller.loading.registry import find
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.plant.structures.mode_file import SUFFIXES, read_modes
from hertzloop.scene.errors import LONGEST, SceneError, quoted_path, shortened
from hertzloop.scene.latency_trace import latencies_of_file
from hertzloop.scene.materials import read_materials

_MOST_BYTES = 64 << 20  # of an unpacked file of modes


def unpack_modes(file: str, sha256: str, content: str) -> bytes:
    """The bytes of a file of modes as a scene holds it. Raises ValueError if they are damaged."""
    try:
        opener = zlib.decompressobj()
        found = opener.decompress(base64.b64decode(content, validate=True), _MOST_BYTES)
    except (binascii.Error, zlib.error) as error:
        raise ValueError(f"plate.modes.content of {file} is damaged: {error}") from error
    if hashlib.sha256(found).hexdigest() != sha256:
        raise ValueError(f"plate.modes.content of {file} is not what plate.modes.sha256 says")
    return found


_MOST_PACKED = 8 << 20  # in a scene, and so in one message on the bus


def inline_files(data: dict[str, Any], folder: Path) -> None:
    """Put files named in a scene's tables in their place; names are relative to `folder`. Raises
    SceneError.

    The table `uncertain` is for `--uncertain` alone: a run has one value for each key.
    """
    try:
        data.pop("uncertain", None)
        if isinstance(data.get("materials"), str):
            data["materials"] = read_materials(folder / data["materials"])
        plate = data.get("plate")
        if isinstance(plate, dict) and isinstance(plate.get("modes"), str):
            plate["modes"] = _packed_modes(folder / plate["modes"])
        control = data.get("controller")
        if isinstance(control, dict):
            trace = control.get("latency_trace")
            if isinstance(trace, str):
                trace = {"file": trace}
            if isinstance(trace, dict):
                use = control.get("latency_trace_use")
                control["latency_trace"] = latencies_of_file(trace, use, folder)
            if control.get("law") in shipped_laws():
                read_files = getattr(find(control["law"]).home, "read_files", None)
                if read_files is not None:
                    read_files(control, folder)
    except ValueError as error:
        raise SceneError(shortened(str(error), LONGEST)) from error


def _packed_modes(path: Path) -> dict[str, str]:
    named = f"plate.modes = {quoted_path(path)}"
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{named}: unknown format. Use a file that ends in {', '.join(SUFFIXES)}.")
    with told_if_unreadable(path, named, "Give the path of a table of modes."):
        content = path.read_bytes()
    read_modes(path.name, content)
    packed = base64.b64encode(zlib.compress(content, 9)).decode("ascii")
    if len(packed) > _MOST_PACKED:
        raise ValueError(
            f"{named}: needs {len(packed) / 1e6:.3g} MB in a "
            f"recording; the limit is {_MOST_PACKED / 1e6:.3g}. Use fewer modes or a coarser grid."
        )
    return {
        "file": path.name,
        "sha256": hashlib.sha256(content).hexdigest(),
        "content": packed,
    }
