"""Parameters and states as records: the same bytes for compiled Python, plain Python and C.

Every field is 8 bytes: a double, a 64-bit integer, or, of an array of parameters, its address
and its count (`profile`, `profile_count`). An array in a state lies in the record itself.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple, get_type_hints

import numpy as np

_FIRST = {"mode": int, "delay": int}
_ARRAYS = (np.ndarray, list, tuple)


class PackedRecord(NamedTuple):
    """A record's layout, its bytes, and the arrays whose addresses it holds."""

    dtype: np.dtype
    data: np.ndarray
    held: tuple[np.ndarray, ...]


def _word(kind: type) -> str:
    return "i8" if issubclass(kind, int | np.integer | np.bool_) else "f8"


@lru_cache(maxsize=256)
def _layout(names: tuple[str, ...], kinds: tuple[type, ...]) -> np.dtype:
    """Layout of parameters by their names and types; raises TypeError as `pack` does."""
    fields: list[tuple[str, str]] = []
    for name, kind in zip(names, kinds, strict=True):
        if issubclass(kind, _ARRAYS):
            fields += [(name, "i8"), (f"{name}_count", "i8")]
        elif issubclass(kind, int | float | np.number | np.bool_):
            fields.append((name, _word(kind)))
        else:
            raise TypeError(
                f"{name} is a {kind.__name__}, neither a number nor an array of numbers"
            )
    return np.dtype(fields or [("unused", "i8")])


def pack(values: Mapping[str, Any]) -> PackedRecord:
    """Parameters as bytes. Raises TypeError for a value that is neither number nor numbers."""
    dtype = _layout(tuple(values), tuple(map(type, values.values())))
    flat: list[Any] = []
    held = []
    for value in values.values():
        if isinstance(value, _ARRAYS):
            array = np.ascontiguousarray(value, dtype=float).ravel()
            held.append(array)
            flat += (array.__array_interface__["data"][0], array.size)
        else:
            flat.append(value)
    record = np.array([tuple(flat or [0])], dtype)
    return PackedRecord(dtype, record.view(np.uint8), tuple(held))


@lru_cache(maxsize=256)
def state_of(home: Any) -> PackedRecord:
    """Layout and first content of the state that a law's class `State` describes.

    `mode` and `delay` come first, described or not. Raises TypeError for a field without a type, or
    without a default that is a number or a tuple of numbers.
    """
    described = getattr(home, "State", None)
    hints = dict.fromkeys([*_FIRST, *(get_type_hints(described) if described else ())])
    for name, value in vars(described).items() if described else ():
        starts = isinstance(value, int | float | np.ndarray | list | tuple)
        if starts and name not in hints and not name.startswith("_"):
            kind = type(value).__name__
            raise TypeError(f"State.{name} needs a type: write {name}: {kind} = {value!r}")
    fields: list[Any] = []
    first: list[Any] = []
    for name in hints:
        value = getattr(described, name, 0 if name in _FIRST else None)
        if isinstance(value, tuple | list | np.ndarray):
            fields.append((name, "f8", (len(value),)))
            first.append(np.asarray(value, float))
        elif isinstance(value, int | float):
            fields.append((name, _word(type(value))))
            first.append(value)
        else:
            raise TypeError(f"State.{name} needs a number, or a tuple of numbers, to start with")
    dtype = np.dtype(fields)
    record = np.zeros(1, dtype)
    record[0] = tuple(first)
    return PackedRecord(dtype, record.view(np.int64), ())
