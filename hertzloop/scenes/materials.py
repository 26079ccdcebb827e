"""Keys of a scene that say what its bodies are: materials, and modes in the place of a plate."""

import base64
import binascii
import difflib
import hashlib
import math
import zlib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Self, cast

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from hertzloop.controller.loading.registry import find
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.plant.structures.materials import (
    MATERIALS,
    SHIPPED,
    Material,
    material_of,
    materials_of,
)
from hertzloop.plant.structures.mode_file import SUFFIXES, read_modes
from hertzloop.scenes.errors import shortened, shown

# What a scene says by the name of a file: materials and modes, taken into the scene itself.
#
# After that the scene needs no file any more: every process, the recording and whoever runs it
# again have the very numbers.

_MOST_BYTES = 64 << 20  # of a file of modes, unpacked
_MOST_PACKED = 8 << 20  # in a scene, and so in one message on the bus


def take_in(data: dict[str, Any], folder: Path) -> None:
    """Put files named in a scene's tables in their place; names are relative to `folder`.

    The table `uncertain` is for `--uncertain` alone: a run has one value for each key.

    Raises ValueError with one sentence.
    """
    data.pop("uncertain", None)
    if isinstance(data.get("materials"), str):
        data["materials"] = _materials(folder / data["materials"])
    plate = data.get("plate")
    if isinstance(plate, dict) and isinstance(plate.get("modes"), str):
        plate["modes"] = _modes(folder / plate["modes"])
    control = data.get("controller")
    trace = control.get("latency_trace") if isinstance(control, dict) else None
    if isinstance(control, dict) and isinstance(trace, str):
        control["latency_trace"] = _latencies(folder / trace)
    elif isinstance(control, dict) and isinstance(trace, dict):
        control["latency_trace"] = _drawn_latencies(trace)
    if isinstance(control, dict) and control.get("law") in shipped_laws():
        read_files = getattr(find(control["law"]).home, "read_files", None)
        if read_files is not None:
            read_files(control, folder)


# Numbers that a distribution of latencies must have, with their least value.
_DRAWN = {"median_us": 0.0, "sigma": 0.0, "autocorrelation": 0.0}
_SAMPLES = 4096
_TRACE = 13  # random stream of these latencies


def _drawn_latencies(table: dict[str, Any]) -> list[float]:
    """Latencies that are log-normal, with an autocorrelation from one sample to the next.

    The logarithms form a first-order autoregressive process. `least_us` is added, `seed` and
    `samples` are 1 and 4096 if left out.
    """
    said = "controller.latency_trace"
    known = {*_DRAWN, "least_us", "seed", "samples"}
    if unknown := sorted(set(table) - known):
        raise ValueError(f"{said}.{unknown[0]}: unknown key. Use {', '.join(sorted(known))}")
    numbers: dict[str, Any] = {"least_us": 0.0, "seed": 1, "samples": _SAMPLES} | table
    for name, least in {**_DRAWN, "least_us": 0.0, "seed": 0, "samples": 1}.items():
        value = numbers.get(name)
        whole = name in ("seed", "samples")
        good = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
        most = {"autocorrelation": 1.0 - 1e-9, "samples": _MOST_LATENCIES}.get(name, 1e6)
        if not good or not least <= cast(float, value) <= most:
            raise ValueError(
                f"{said}.{name} = {shown(value)}: must be a {'whole ' if whole else ''}number from "
                f"{least:g} to {most:g}"
            )
    normal = np.random.Generator(np.random.Philox(key=[numbers["seed"], _TRACE])).standard_normal(
        numbers["samples"]
    )
    keep, walk = numbers["autocorrelation"], float(normal[0])
    found = [walk]
    for one in normal[1:]:
        walk = keep * walk + math.sqrt(1.0 - keep * keep) * float(one)
        found.append(walk)
    logs = numbers["sigma"] * np.array(found)
    return [round(float(x), 3) for x in numbers["least_us"] + numbers["median_us"] * np.exp(logs)]


_LATENCY = "latency_us"  # column of a trace that has several
_MOST_LATENCIES = 1_000_000


def _latencies(path: Path) -> list[float]:
    """Latencies of a CSV file, us: its only column, or the one called latency_us; lines that begin
    with # are comments. Of a recording (.mcap) of a paced run, those that it had."""
    said = f"controller.latency_trace = {_echoed(path)}"
    if path.suffix == ".mcap":
        from hertzloop.recordings.latencies import read_latencies

        try:
            return read_latencies(path)
        except (ValueError, OSError, RuntimeError) as error:
            raise ValueError(f"{said}: {shortened(str(error))}") from error
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise ValueError(f"{said}: cannot be read: {shortened(str(error))}") from error
    lines = [line.split(",") for line in text.splitlines() if line.strip() and line[0] != "#"]
    names = [name.strip() for name in lines[0]] if lines else []
    column = names.index(_LATENCY) if _LATENCY in names else 0
    if len(names) > 1 and _LATENCY not in names:
        raise ValueError(f"{said}: has several columns. Call one of them {_LATENCY}")
    found = []
    for number, line in enumerate(lines):
        try:
            found.append(float(line[column]))
        except (ValueError, IndexError):
            if number:
                raise ValueError(
                    f"{said}: line {number + 1} has no number. Give a latency in us in every line"
                ) from None
    if not 1 <= len(found) <= _MOST_LATENCIES:
        raise ValueError(f"{said}: has {len(found)} latencies. Give 1 to {_MOST_LATENCIES}")
    return found


def open_material(data: dict[str, Any], body: str, key: str = "material") -> None:
    """Put a material's numbers in the place of its name, so that one of them can be changed."""
    table = data.get(body)
    name = table.get(key) if isinstance(table, dict) else None
    if not isinstance(table, dict) or not isinstance(name, str):
        return
    materials = data.get("materials")
    for own in materials if isinstance(materials, list | tuple) else ():
        if isinstance(own, dict) and own.get("name") == name:
            table[key] = dict(own)
            return
    if name in SHIPPED:
        table[key] = {"name": name, **SHIPPED[name]}


def _echoed(path: Path) -> str:
    """A file's path as a sentence has it."""
    return shortened(repr(str(path)))


def _materials(path: Path) -> list[dict[str, object]]:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise ValueError(
            f"materials = {_echoed(path)}: cannot be read: {shortened(str(error))}"
        ) from error
    return [{"name": name, **table} for name, table in materials_of(text, str(path)).items()]


def _modes(path: Path) -> dict[str, str]:
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(
            f"plate.modes = {_echoed(path)}: unknown format. Use a file that ends in "
            f"{', '.join(SUFFIXES)}."
        )
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise ValueError(f"plate.modes = {_echoed(path)}: cannot be read: {why}") from error
    read_modes(path.name, content)
    packed = base64.b64encode(zlib.compress(content, 9)).decode("ascii")
    if len(packed) > _MOST_PACKED:
        raise ValueError(
            f"plate.modes = {_echoed(path)}: needs {len(packed) / 1e6:.3g} MB in a recording; the "
            f"limit is {_MOST_PACKED / 1e6:.3g}. Use fewer modes or a coarser grid."
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


_LONGEST = 80  # letters of a name that are compared


class SceneTable(BaseModel):
    """A table of a scene: no other keys, no change, finite numbers; a docstring for each key,
    which `hertzloop scene keys` prints."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=False,
        allow_inf_nan=False,
    )
    __slots__ = ("_hash",)  # a copy has none yet

    def replaced(self, **values: Any) -> Self:
        """Return a copy with other values that are checked already. `model_copy` does the same in
        ten times as long, which counts where cases are made by the thousand."""
        new = type(self).__new__(type(self))
        object.__setattr__(new, "__dict__", vars(self) | values)
        object.__setattr__(new, "__pydantic_fields_set__", self.__pydantic_fields_set__)
        object.__setattr__(new, "__pydantic_extra__", self.__pydantic_extra__)
        object.__setattr__(new, "__pydantic_private__", self.__pydantic_private__)
        return new

    def __hash__(self) -> int:
        """Kept: what many scenes share is looked up by its tables again and again."""
        found: int | None = getattr(self, "_hash", None)
        if found is None:
            found = hash((type(self), *vars(self).values()))
            object.__setattr__(self, "_hash", found)
        return found


class MaterialTable(SceneTable):
    """A material by its numbers; `plant.structures.materials` says which can be. `name`, in a
    list of materials, is what plate.material, sphere.material and hammer.tip_material
    may say."""

    name: str | None = None
    young_pa: float | None = None
    density_kg_m3: float
    poisson: float | None = None
    young_x_pa: float | None = None
    young_y_pa: float | None = None
    young_z_pa: float | None = None
    shear_pa: float | None = None
    poisson_xy: float | None = None
    loss_factor: float | None = None
    restitution: float | None = None
    yield_pa: float | None = None
    hardness_pa: float | None = None
    strength_spread: float | None = None


class ModesTable(SceneTable):
    """A file of modes, taken into the scene: its name, the digest of its bytes, and these, packed
    by zlib, in base64."""

    file: str
    sha256: str
    content: Annotated[str, Field(repr=False)]


MaterialKey = str | MaterialTable


def _numbers(table: Mapping[str, Any]) -> dict[str, Any]:
    """A material's table without its name."""
    return {key: value for key, value in table.items() if key != "name" and value is not None}


@lru_cache(maxsize=64)
def material_called(given: MaterialKey, own: tuple[MaterialTable, ...]) -> Material:
    """A material by its numbers or its name, of the scene's own first."""
    if isinstance(given, str):
        named = next((table for table in own if table.name == given), None)
        if named is None:
            return MATERIALS[given]
        given = named
    return material_of("material", _numbers(given.model_dump()))


def check_materials(data: Mapping[str, Any]) -> None:
    """Raise ValueError with one sentence for what is no material in a scene's tables."""
    known = dict.fromkeys(MATERIALS)
    given = data.get("materials")
    for own in given if isinstance(given, list | tuple) else ():
        if isinstance(own, dict):
            name = str(own.get("name", ""))
            if not name:
                raise ValueError("materials: an entry has no name. Add its name.")
            material_of(f"materials: {name}", _numbers(own))
            known[name] = None
    for body, key in (("plate", "material"), ("sphere", "material"), ("hammer", "tip_material")):
        table = data.get(body)
        given = table.get(key) if isinstance(table, dict) else None
        if isinstance(given, dict):
            material_of(f"{body}.{key}", _numbers(given))
        elif isinstance(given, str) and given not in known:
            close = difflib.get_close_matches(given[:_LONGEST], known, 1)
            hint = f"Did you mean {close[0]}? " if close else ""
            raise ValueError(
                f"{body}.{key} = {shown(given)}: unknown material. {hint}Use one of "
                f"{', '.join(known)}, or give young_pa, density_kg_m3 and poisson."
            )
