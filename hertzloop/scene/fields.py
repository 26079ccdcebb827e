"""The fields of tables, and in words what each can be: kind, bounds and unit."""

from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from hertzloop.common.readable import number

# Endings of names, longer ones first.
_UNITS = {
    "_m_s": "m/s",
    "_m_n": "m/N",
    "_n_s_m": "N s/m",
    "_n_s": "N/s",
    "_kg_m3": "kg/m3",
    "_ppm": "ppm",
    "_pa": "Pa",
    "_kg": "kg",
    "_hz": "Hz",
    "_us": "us",
    "_ns": "ns",
    "_m": "m",
    "_s": "s",
    "_n": "N",
}
_WORDS = {float: "number", int: "whole number", str: "text", bool: "true or false", Path: "text"}

_ENDS = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}


def unit_of(name: str) -> tuple[str, str]:
    """A key's or metric's name without the ending that says its unit, and the unit, "" if none."""
    ending = next((end for end in _UNITS if name.endswith(end)), "")
    return name.removesuffix(ending), _UNITS.get(ending, "")


def takes(name: str, field: Any) -> str:
    """Return what a field can be: kind, unless it is a number with bounds; bounds and unit."""
    kind, bounds = " or ".join(dict.fromkeys(_kinds(field.annotation))), _bounds_of(field)
    with_unit = f"{bounds} {unit_of(name)[1]}".strip()
    return ", ".join(filter(None, ("" if kind == "number" and bounds else kind, with_unit)))


def _kinds(kind: Any) -> Iterator[str]:
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        yield from _kinds(inner[0])
    elif origin is Literal:
        yield ", ".join(f'"{value}"' for value in inner)
    elif origin in (Union, UnionType):
        for one in inner:
            if one is not NoneType:
                yield from _kinds(one)
    elif origin is tuple:
        many = inner[-1] is Ellipsis
        words = next(_kinds(inner[0]))
        words = words.replace("list", "lists", 1) if words.startswith("list") else f"{words}s"
        yield f"list of {words}" if many else f"{len(inner)} {words}"
    elif isinstance(kind, type) and issubclass(kind, StrEnum):
        yield ", ".join(f'"{value}"' for value in kind)
    elif isinstance(kind, type) and issubclass(kind, BaseModel):
        yield "table"
    else:
        yield _WORDS.get(kind, str(kind))


def parts_of(kind: Any) -> Iterator[Any]:
    """A field or an annotation, and all that is written into it, however deep."""
    yield kind
    about = (*getattr(kind, "metadata", ()), *getattr(kind, "__metadata__", ()))
    for inner in (*about, getattr(kind, "annotation", None), *get_args(kind)):
        if inner is not None:
            yield from parts_of(inner)


def table_of(annotation: Any) -> type[BaseModel] | None:
    """The table that a key can be; None of a value."""
    parts = (one for one in parts_of(annotation) if isinstance(one, type))
    return next((one for one in parts if issubclass(one, BaseModel)), None)


def fields_at(path: Sequence[str], model: type[BaseModel]) -> dict[str, FieldInfo]:
    """The keys of the table at `path` of a scene, none of a value. Raises KeyError for what is no
    key."""
    fields = model.model_fields
    for part in path:
        table = table_of(fields[part].annotation)
        fields = table.model_fields if table else {}
    return fields


def _bounds_of(field: Any) -> str:
    """Range of a field in words, which say whether its ends belong to it; "" if it has none."""
    limits = {
        name: number(getattr(one, name))
        for one in parts_of(field)
        for name in _ENDS
        if hasattr(one, name)
    }
    if limits.keys() == {"ge", "le"}:
        return f"{limits['ge']} to {limits['le']}"
    return " and ".join(
        f"{words} {limits[name]}" for name, words in _ENDS.items() if name in limits
    )
