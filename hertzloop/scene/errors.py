"""The error of a scene that cannot be simulated, and its sentences."""

import difflib
import reprlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from hertzloop.common.readable import number


class SceneError(ValueError):
    """The scene cannot be simulated. The message names the key, its value and the remedy."""

    exit_status = 2


_LONGEST = 80  # letters of a value, of another's sentence some more
LONGEST = 600  # letters of a whole sentence

_repr = reprlib.Repr()
_repr.maxstring = _repr.maxother = _repr.maxlong = _LONGEST
_repr.maxlist = _repr.maxtuple = _repr.maxdict = 4
_repr.maxlevel = 3


def shown(value: Any) -> str:
    """A refused value as it is echoed: its representation, the middle left out if it is long."""
    try:
        return shortened(_repr.repr(value))
    except ValueError:  # Python writes no whole number of more than 4300 digits
        return f"a number of {value.bit_length()} bits"


def shortened(text: str, longest: int = 3 * _LONGEST) -> str:
    """Text without its middle if it is long."""
    half = longest // 2
    return text if len(text) <= longest else f"{text[:half]}...{text[-half:]}"


def unknown_key(path: tuple[str, ...], known: list[str]) -> str:
    """Sentence on a key that there is not."""
    close = difflib.get_close_matches(path[-1][:_LONGEST], known, 1)
    hint = f"Did you mean {close[0]}? " if close else ""
    key = shortened(".".join(path), _LONGEST)
    return f"{key}: unknown scene key. {hint}Known keys: {', '.join(known)}."


def _refused(keys: tuple[str, ...], value: Any, problems: Iterable[Any], field: Any) -> str:
    """Sentence on a value that will not do, of pydantic's `problems` with it and the `field`."""
    wanted = " or ".join(dict.fromkeys(_wanted(problem) for problem in problems))
    bounds = bounds_of(field)
    between = bounds if bounds.startswith(_OPEN) else f"from {bounds}"
    several = any(problem["type"].startswith("tuple") for problem in problems)
    remedy = f". Give {'values' if several else 'a value'} {between}." if bounds else "."
    return f"{'.'.join(keys)} = {shown(value)}: must be {wanted}{remedy}"


_PAIR = "a list of two numbers, such as [0.1, 0.2]"
_WANTED = {
    "int": "a whole number",
    "float": "a number",
    "finite_number": "a finite number",
    "bool": "true or false",
    "string": "text",
    "path": "text",
    "model": "a table",
    "dict": "a table",
    "tuple": "a list in brackets, such as [0.1, 0.2]",
    "missing": _PAIR,
    "too_long": _PAIR,
    "greater_than_equal": "at least {ge}",
    "less_than_equal": "at most {le}",
    "greater_than": "more than {gt}",
    "less_than": "less than {lt}",
    "literal_error": "{expected}",
}


def _wanted(problem: Any) -> str:
    """What pydantic asks for, in words that follow "must be"."""
    kind = problem["type"]
    words = _WANTED.get(kind) or _WANTED.get(kind.partition("_")[0])
    if words is None or "pattern" in kind or "too_short" in kind:
        message: str = problem["msg"]
        return message.replace("Input should ", "").removeprefix("be ").removeprefix("have ")
    limits = problem.get("ctx", {})
    numbers = (int, float)
    return words.format(
        **{name: number(x) if isinstance(x, numbers) else x for name, x in limits.items()}
    )


def sentence(error: ValidationError, model: type[BaseModel], within: tuple[str, ...] = ()) -> str:
    """The first problem of a scene, or of the table `within` it, checked against `model`, as one
    sentence. An unknown key comes first: it may be a missing one, misspelt."""
    problem = min(error.errors(), key=lambda one: one["type"] != "extra_forbidden")
    kind, value = problem["type"], problem["input"]
    if kind == "value_error":
        return shortened(str(problem["ctx"]["error"]), LONGEST)
    if kind == "extra_forbidden":
        path, last = _keys(problem["loc"][:-1], model), str(problem["loc"][-1])
        tables = tables_at(path, model)
        if last not in fields_of(tables):
            return unknown_key((*within, *path, last), list(fields_of(tables)))
        table, key = ".".join((*within, *path)), ".".join((*within, *path, last))
        chosen = next(one for one in tables if one.__name__ in problem["loc"])
        other = next(told(table, one) for one in tables if last in one.model_fields)
        either = told(table, chosen).endswith("'") or chosen is tables[-1]
        remedy = f"Leave it out, or give {other}." if either else "Leave one of them out."
        return f"{key} = {shown(value)}: has no effect with {told(table, chosen)}. {remedy}"
    keys = _keys(problem["loc"], model)
    if kind == "missing" and keys[-1] == problem["loc"][-1]:
        tables = tables_at(keys[:-1], model)
        needs = {one for one in tables if fields_of([one]).get(keys[-1], _NONE).is_required()}
        others = [f", or {told(keys[0], one)}" for one in tables if one not in needs]
        return f"{'.'.join((*within, *keys))}: is missing from the scene. Add it{''.join(others)}."
    same = [p for p in error.errors() if _keys(p["loc"], model) == keys]
    field = fields_of(tables_at(keys[:-1], model))[keys[-1]]
    return _refused((*within, *keys), value, same, field)


_NONE = FieldInfo(default=None)


def told(name: str, table: Any) -> str:
    """What makes the table `name` one of its kinds."""
    key, value = table.TOLD_BY
    return f"{name}.{key}" + (f" = '{value}'" if value else "")


def parts_of(kind: Any) -> Iterator[Any]:
    """A field or an annotation, and all that is written into it, however deep."""
    yield kind
    about = (*getattr(kind, "metadata", ()), *getattr(kind, "__metadata__", ()))
    for inner in (*about, getattr(kind, "annotation", None), *get_args(kind)):
        if inner is not None:
            yield from parts_of(inner)


def tables_of(annotation: Any) -> list[type[BaseModel]]:
    """The tables that a key can have: several of a table of several kinds, none of a value."""
    return [
        one for one in parts_of(annotation) if isinstance(one, type) and issubclass(one, BaseModel)
    ]


def tables_at(path: Sequence[str], model: type[BaseModel]) -> list[type[BaseModel]]:
    """The table at `path` of a scene: one, several of a table of several kinds, none for a value.
    Raises KeyError for what is no key."""
    found = [model]
    for part in path:
        found = tables_of(fields_of(found)[part].annotation)
    return found


def fields_of(tables: Iterable[type[BaseModel]]) -> dict[str, Any]:
    """The keys of a table, of all its kinds."""
    found: dict[str, Any] = {}
    for table in tables:
        found |= {key: field for key, field in table.model_fields.items() if key not in found}
    return found


def _keys(loc: Iterable[Any], model: type[BaseModel]) -> list[str]:
    """The part of an error's location that names scene keys, without branches of unions."""
    found: list[str] = []
    for part in map(str, loc):
        if part in fields_of(tables_at(found, model)):
            found.append(part)
    return found


def bounds_of(field: Any) -> str:
    """Range of a field in words, which say whether its ends belong to it; "" if it has not both
    ends."""
    limits = {
        name: getattr(one, name)
        for one in parts_of(field)
        for name in ("ge", "gt", "le", "lt")
        if hasattr(one, name)
    }
    low, high = limits.get("ge", limits.get("gt")), limits.get("le", limits.get("lt"))
    if low is None or high is None:
        return ""
    if "ge" in limits and "le" in limits:
        return f"{number(low)} to {number(high)}"
    least = _OPEN[0] if "ge" in limits else _OPEN[1]
    most = "at most" if "le" in limits else "less than"
    return f"{least} {number(low)} and {most} {number(high)}"


_OPEN = ("at least", "more than")  # how a range begins one of whose ends does not belong to it


def quoted_path(path: Path) -> str:
    """A path as an error shows it."""
    return shortened(repr(str(path)))
