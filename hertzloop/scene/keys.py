"""All keys of a scene with kind, bounds, default and meaning, as the code has them."""

import ast
import inspect
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import groupby, pairwise

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from hertzloop.controller.loading.registry import find, shipped
from hertzloop.scene.fields import table_of, takes
from hertzloop.scene.scene import Scene


@dataclass(frozen=True)
class Key:
    """A key of a scene: its possible values and its default are text."""

    name: str
    possible: str
    default: str
    meaning: str


def keys() -> list[Key]:
    """All keys in the order of a scene's tables, those of shipped laws after the controller's."""
    return list(_of_table(Scene, ""))


def _of_table(table: type[BaseModel], before: str) -> Iterator[Key]:
    for name, field in table.model_fields.items():
        inner = table_of(field.annotation)
        if inner and not before and name != "materials":
            yield from _of_table(inner, f"{name}.")
            if name == "controller":
                yield from _of_laws()
        else:
            yield _key(before + name, field, _docstrings(table).get(name, ""))


@cache
def _docstrings(table: type[BaseModel]) -> dict[str, str]:
    """The docstrings of a table's keys. Pydantic would read them whenever it is imported."""
    (definition,) = ast.parse(inspect.getsource(table)).body
    assert isinstance(definition, ast.ClassDef)
    return {
        key.target.id: inspect.cleandoc(docstring.value.value)
        for key, docstring in pairwise(definition.body)
        if isinstance(key, ast.AnnAssign)
        and isinstance(key.target, ast.Name)
        and isinstance(docstring, ast.Expr)
        and isinstance(docstring.value, ast.Constant)
        and isinstance(docstring.value.value, str)
    }


def _of_laws() -> Iterator[Key]:
    users: dict[Key, list[str]] = {}
    for law in shipped():
        for key in keys_of(law):
            users.setdefault(key, []).append(law)
    for key, laws in users.items():
        yield Key(**{**vars(key), "meaning": f"{key.meaning} ({', '.join(laws)})"})


def _key(name: str, field: FieldInfo, meaning: str) -> Key:
    """A key. A default that the code works out follows the meaning, after "; default: "."""
    meaning, _, default = meaning.replace("\n", " ").partition("; default: ")
    if field.is_required():
        default = "needed"
    elif field.default is not None:
        default = repr(field.default).replace("'", '"')
    return Key(
        name=name,
        possible=takes(name, field),
        default=default,
        meaning=meaning,
    )


def page() -> str:
    """The keys as a page in Markdown, by table; `hertzloop fit` writes those of `[fit]`."""
    lines = [
        "# Scene keys",
        "",
        "The word before the dot is the table. `hertzloop scene keys` prints these keys, and",
        "with `--law mine.py` those of your own law. `hertzloop fit` writes the table `[fit]`.",
        "Without a default, an omitted key has no effect, or other keys replace it.",
    ]
    for table, of_table in groupby(keys(), lambda key: key.name.rpartition(".")[0]):
        if table == "fit":
            continue
        lines += ["", *([f"## `[{table}]`", ""] if table else [])]
        lines += [f"- `{key.name}` ({value_of(key)}): {key.meaning}" for key in of_table]
    return "\n".join(lines) + "\n"


def value_of(key: Key) -> str:
    """What a key takes, and its default."""
    default = key.default if key.default in ("", "needed") else f"default {key.default}"
    return f"{key.possible}{default and f'; {default}'}"


def keys_of(law: str) -> list[Key]:
    """The keys of one law, by whatever `controller.law` may say. Raises LawError."""
    return [
        _key(f"controller.{name}", field, field.description or "")
        for name, field in find(law).keys.model_fields.items()
    ]
