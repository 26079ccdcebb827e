"""Which fields of a dataclass are not at their defaults."""

from collections.abc import Collection
from dataclasses import fields
from typing import Any


def changed_fields(part: Any, but: Collection[str]) -> list[str]:
    """Return the names of the fields of a dataclass that differ from their defaults, except those
    of `but`."""
    names = {one.name: one.default for one in fields(part) if one.name not in but}
    return [name for name, default in names.items() if getattr(part, name) != default]
