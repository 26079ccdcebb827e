"""Fields of numbers, as a user writes them."""

from collections.abc import Callable
from typing import Any

from pydantic_core import PydanticKnownError


def refuse_no_numbers(value: Any, read: Callable[[Any], Any]) -> Any:
    """Read a field, but refuse true, false and text for a number, which pydantic would read as 1, 0
    and the number in the text; a wrap validator."""
    found = read(value)
    given, made = [value], [found]
    if isinstance(value, list | tuple) and isinstance(found, list | tuple):
        given, made = list(value), list(found)
    if {bool, str}.isdisjoint(map(type, given)):  # in C: a trace has some 100 000 numbers
        return found
    for one, made_of in zip(given, made, strict=False):
        if isinstance(one, bool | str) and type(made_of) in (int, float):
            raise PydanticKnownError("int_type" if isinstance(made_of, int) else "float_type")
    return found
