"""Fields of numbers, as a user writes them."""

from collections.abc import Callable
from typing import Any

from pydantic_core import PydanticKnownError


def refuse_no_numbers(value: Any, read: Callable[[Any], Any]) -> Any:
    """Read a field, but refuse true, false and text for a number, which pydantic would read as 1, 0
    and the number in the text; a wrap validator."""
    found = read(value)
    pairs = [(value, found)]
    if isinstance(value, list | tuple) and isinstance(found, list | tuple):
        pairs = list(zip(value, found, strict=False))
    for given, made in pairs:
        if isinstance(given, bool | str) and type(made) in (int, float):
            raise PydanticKnownError("int_type" if isinstance(made, int) else "float_type")
    return found
