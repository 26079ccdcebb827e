"""A scene's tables with other values of some keys, each checked by itself and kept.

The cases of a sweep give a table the same few values again and again.
"""

from collections import defaultdict
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from pydantic import BaseModel, ValidationError

from hertzloop.scenes.materials import Table

_KEPT = 4096
# What other tables, or files, have a say in.
_NOT_ALONE = {
    "plate.material", "plate.modes", "sphere.material", "sensors.quantity", "controller.law",
    "controller.law_digest",
}  # fmt: skip


def changed_tables(scene: BaseModel, values: Mapping[str, Any]) -> dict[str, Table] | None:
    """The tables that hold the keys "table.key" of `values`, with these; None where that takes
    more than these tables, or one of them does not allow it."""
    by_table: dict[str, dict[str, Any]] = defaultdict(dict)
    for key, value in values.items():
        name, dot, last = key.partition(".")
        if key in _NOT_ALONE or not dot or "." in last:
            return None
        by_table[name][last] = value
    found = {}
    for name, changes in by_table.items():
        table = getattr(scene, name, None)
        if not isinstance(table, Table):
            return None
        try:
            changed = _changed(table, tuple(changes), *changes.values())
        except TypeError:  # a list cannot be looked up
            return None
        if changed is None:
            return None
        found[name] = changed
    return found


@lru_cache(maxsize=_KEPT, typed=True)  # True is no 1
def _changed(table: Table, names: tuple[str, ...], *values: Any) -> Table | None:
    given = vars(table) | (table.__pydantic_extra__ or {})
    try:
        return type(table).model_validate(given | dict(zip(names, values, strict=True)))
    except ValidationError:
        return None
