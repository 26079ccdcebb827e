"""Parameters and states as records: the same bytes for compiled Python, plain Python and C.

A number is 8 bytes: a double or a 64-bit integer. Of an array of parameters the record holds the
address and the lengths of its axes; an array in a state lies in the record itself.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple, get_type_hints

import numpy as np

_FIRST = {"mode": int, "delay": int}
_ARRAYS = (np.ndarray, list, tuple)
_FLOATS, _INTEGERS = np.dtype(float), np.dtype(np.int64)


class PackedRecord(NamedTuple):
    """A record's layout, its bytes, and the arrays whose addresses it holds."""

    dtype: np.dtype
    data: np.ndarray
    held: tuple[np.ndarray, ...]


def _word(kind: type) -> str:
    return "i8" if issubclass(kind, int | np.integer | np.bool_) else "f8"


def seen_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters as a law sees them: numbers, and plain C-contiguous arrays.

    An array has doubles, or 64-bit integers or bools where it is a NumPy array of such; a list or
    a tuple becomes an array of doubles.

    Raises:
        TypeError: a value is neither a number nor an array of numbers; the sentence says what to
            write.
    """
    return {name: _seen(name, value) for name, value in values.items()}


def _seen(name: str, value: Any) -> Any:
    if type(value) is float:
        return value
    if isinstance(value, complex | np.complexfloating):
        raise TypeError(_complex(name))
    if isinstance(value, np.number | np.bool_):
        value = float(value) if isinstance(value, np.floating) else value.item()
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise TypeError(f"{name} = {value} needs more than 64 bits. Give a float.")
    if isinstance(value, _ARRAYS):
        return _array(name, value)
    if not isinstance(value, int | float):
        kind = type(value).__name__
        raise TypeError(f"{name} is a {kind}, neither a number nor an array of numbers")
    return value


def _array(name: str, value: Any) -> Any:
    """Return an array of numbers; a number for an array without an axis."""
    kind = type(value).__name__
    if isinstance(value, np.ndarray) and type(value) is not np.ndarray:
        raise TypeError(f"{name} is a {kind}. Give a plain array: np.array({name}).")
    if hasattr(value, "_fields"):
        raise TypeError(f"{name} is the NamedTuple {kind}. Give its fields one by one.")
    try:
        array = np.asarray(value)
    except ValueError:
        raise TypeError(f"{name} has rows of different lengths. Give an array for each.") from None
    if array.dtype.kind == "c":
        raise TypeError(_complex(name))
    if array.dtype.kind not in "biuf":
        raise TypeError(f"{name} holds something else than numbers. Give an array of numbers.")
    if not isinstance(value, np.ndarray) or array.dtype.kind == "f":
        array = array.astype(_FLOATS, copy=False)
    elif array.dtype.kind in "iu":
        if array.dtype == np.uint64 and np.any(array > np.iinfo(_INTEGERS).max):
            raise TypeError(f"{name} needs more than 63 bits. Give an array of floats.")
        array = array.astype(_INTEGERS, copy=False)
    return np.ascontiguousarray(array) if array.ndim else array.item()


def _complex(name: str) -> str:
    return f"{name} is complex. Give two real arrays or numbers: {name}.real and {name}.imag."


# Of an array: the name of its kind of number, with its address; then the lengths of its axes.
@lru_cache(maxsize=256)
def _layout(names: tuple[str, ...], kinds: tuple[tuple[str, int], ...]) -> np.dtype:
    """Layout of parameters by their names, and by word and number of axes; -1 of a number."""
    fields: list[tuple[str, Any]] = [
        (name, word if axes < 0 else [(word, "i8"), ("shape", "i8", (axes,))])
        for name, (word, axes) in zip(names, kinds, strict=True)
    ]
    return np.dtype(fields or [("unused", "i8")])


def pack(values: Mapping[str, Any]) -> PackedRecord:
    """Pack parameters as a law sees them, see `seen_values`, into bytes."""
    kinds: list[tuple[str, int]] = []
    flat: list[Any] = []
    held: list[np.ndarray] = []
    for value in values.values():
        if isinstance(value, np.ndarray):
            kinds.append((value.dtype.name, value.ndim))
            flat.append((value.ctypes.data, value.shape))
            held.append(value)
        else:
            kinds.append((_word(type(value)), -1))
            flat.append(value)
    dtype = _layout(tuple(values), tuple(kinds))
    record = np.array([tuple(flat) or (0,)], dtype)
    return PackedRecord(dtype, record.view(np.uint8), tuple(held))


@lru_cache(maxsize=256)
def state_of(home: Any) -> PackedRecord:
    """Layout and first content of the state that a law's class `State` describes.

    `mode` and `delay` come first, described or not. Raises TypeError for a field without a type, or
    without a default that is a number or an array of numbers.
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
        if isinstance(value, _ARRAYS):
            start = np.asarray(_array(f"State.{name}", value), float)
            fields.append((name, "f8", start.shape))
            first.append(start)
        elif isinstance(value, int | float | np.number) and not isinstance(value, complex):
            fields.append((name, _word(type(value))))
            first.append(value)
        else:
            raise TypeError(f"State.{name} needs a number, or an array of numbers, to start with")
    dtype = np.dtype(fields)
    record = np.zeros(1, dtype)
    record[0] = tuple(first)
    return PackedRecord(dtype, record.view(np.int64), ())
