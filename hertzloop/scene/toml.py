"""Scenes and values as TOML text."""

import json
import tomllib
from typing import Any

import tomli_w
from pydantic import BaseModel


def parse_toml(text: str) -> dict[str, Any]:
    """TOML as plain data. Raises ValueError for whatever it cannot be, whatever the reason."""
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("its tables or lists are nested too deeply") from error


def toml_value(text: str) -> Any:
    """A value as written in TOML; a bare word counts as text."""
    try:
        return parse_toml(f"value = {text}")["value"]
    except ValueError:
        return text.strip()


def toml_text(value: Any) -> str:
    """A value as `toml_value` reads it, in one line; a text without quotes where that is enough."""
    bare = isinstance(value, str) and toml_value(value) == value
    return value if bare else json.dumps(value)


def to_toml(scene: BaseModel, law: str | None = None, brief: bool = False) -> str:
    """Return a scene as TOML, every key written out; `law`: another reference to the same law;
    `brief`: without what files of modes and of latencies hold."""
    tables = scene.model_dump(exclude_none=True)
    if brief:
        tables["plate"].get("modes", {}).pop("content", None)
        tables["controller"].pop("latency_trace", None)
    if law is not None:
        tables["controller"]["law"] = law
    return tomli_w.dumps(tables)
