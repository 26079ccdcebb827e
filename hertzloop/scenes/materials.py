"""Keys of a scene that say what its bodies are: materials, and modes in the place of a plate."""

import difflib
from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field

from hertzloop.scenes.errors import shown
from plant.structures.materials import MATERIALS, Material, material_of

_LONGEST = 80  # letters of a name that are compared


class Table(BaseModel):
    """A table of a scene: no other keys, no change, finite numbers; a docstring for each key."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=False,
        allow_inf_nan=False,
        use_attribute_docstrings=True,  # `hertzloop keys` prints them
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


class MaterialTable(Table):
    """A material by its numbers; `plant.structures.materials` says which can be. `name`, in a
    list of materials, is what plate.material and sphere.material may say."""

    name: str | None = None
    young_pa: float
    density_kg_m3: float
    poisson: float
    loss_factor: float | None = None
    restitution: float | None = None
    yield_pa: float | None = None
    hardness_pa: float | None = None
    strength_spread: float | None = None


class ModesTable(Table):
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
                raise ValueError("materials: one has no name, by which it could be taken")
            material_of(f"materials: {name}", _numbers(own))
            known[name] = None
    for body in ("plate", "sphere"):
        table = data.get(body)
        given = table.get("material") if isinstance(table, dict) else None
        if isinstance(given, dict):
            material_of(f"{body}.material", _numbers(given))
        elif isinstance(given, str) and given not in known:
            close = difflib.get_close_matches(given[:_LONGEST], known, 1)
            hint = f"did you mean {close[0]}? " if close else ""
            raise ValueError(
                f"{body}.material = {shown(given)} is not known; {hint}Known are "
                f"{', '.join(known)}, or give its numbers: young_pa, density_kg_m3, poisson"
            )
