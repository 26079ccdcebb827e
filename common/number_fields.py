"""Fields of numbers, as a user writes them."""

from collections.abc import Callable
from typing import Any

from pydantic_core import PydanticKnownError


def refuse_no_numbers(value: Any, read: Callable[[Any], Any]) -> Any:
    """Read a field, but refuse true, false and text for a number, which pydantic would read as 1, 0
    and the number in the text; a wrap validator."""
    found = read(value)
    several = isinstance(value, list | tuple) and isinstance(found, list | tuple)
    given = value if several else [value]
    # By the types alone: a trace has some 100 000 numbers.
    if not any(issubclass(kind, bool | str) for kind in set(map(type, given))):
        return found
    for one, made in zip(given, found if several else [found], strict=False):
        if isinstance(one, bool | str) and type(made) in (int, float):
            raise PydanticKnownError("int_type" if isinstance(made, int) else "float_type")
    return found
