"""Which fields of a dataclass are not at their defaults."""

from collections.abc import Collection
from dataclasses import fields
from functools import cache
from typing import Any


def changed_fields(part: Any, but: Collection[str]) -> list[str]:
    """Return the names of the fields of a dataclass that differ from their defaults, except those
    of `but`."""
    return [
        name
        for name, default in _defaults(part.__class__)
        if name not in but and getattr(part, name) != default
    ]


@cache  # a case of a sweep asks several times
def _defaults(kind: Any) -> list[tuple[str, Any]]:
    return [(one.name, one.default) for one in fields(kind)]
