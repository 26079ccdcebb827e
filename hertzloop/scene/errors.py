"""The sentences of errors in a scene."""

import difflib
import reprlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from hertzloop.common.errors import SceneError as SceneError
from hertzloop.scene.fields import fields_at, takes

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


def sentence(error: ValidationError, model: type[BaseModel], within: tuple[str, ...] = ()) -> str:
    """The first problem of a scene, or of the table `within` it, checked against `model`, as one
    sentence. An unknown key comes first: it may be a missing one, misspelt."""
    problem = min(error.errors(), key=lambda one: one["type"] != "extra_forbidden")
    kind, value = problem["type"], problem["input"]
    if kind == "value_error":
        return shortened(str(problem["ctx"]["error"]), LONGEST)
    if kind == "extra_forbidden":
        path, last = _keys(problem["loc"][:-1], model), str(problem["loc"][-1])
        return unknown_key((*within, *path, last), list(fields_at(path, model)))
    keys = _keys(problem["loc"], model)
    if kind == "missing" and keys[-1] == problem["loc"][-1]:
        return f"{'.'.join((*within, *keys))}: is missing from the scene. Add it."
    possible = takes(keys[-1], fields_at(keys[:-1], model)[keys[-1]])
    key = ".".join((*within, *keys))
    return f"{key} = {shown(value)}: is not possible. Possible values: {possible}."


def _keys(loc: Iterable[Any], model: type[BaseModel]) -> list[str]:
    """The part of an error's location that names scene keys, without branches of unions."""
    found: list[str] = []
    for part in map(str, loc):
        if part in fields_at(found, model):
            found.append(part)
    return found


def quoted_path(path: Path) -> str:
    """A path as an error shows it."""
    return shortened(repr(str(path)))
