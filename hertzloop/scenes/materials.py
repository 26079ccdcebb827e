"""Keys of a scene that say what its bodies are: materials, and modes in the place of a plate."""

import base64
import binascii
import hashlib
import zlib
from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field

from hertzloop.plant.structures.materials import (
    MATERIALS,
    Material,
    material_of,
)

_MOST_BYTES = 64 << 20  # of a file of modes, unpacked


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


def numbers_of_material(table: Mapping[str, Any]) -> dict[str, Any]:
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
    return material_of("material", numbers_of_material(given.model_dump()))
