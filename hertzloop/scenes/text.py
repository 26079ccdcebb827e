"""Scenes as TOML text: those that come with hertzloop, and single values."""

import tomllib
from importlib import resources
from typing import Any

import tomli_w

DEFAULT = "aluminium-20mm"


def shipped() -> list[str]:
    """Names of the scenes that come with hertzloop, the default first."""
    folder = resources.files("hertzloop") / "scenes"
    names = [f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")]
    return sorted(names, key=lambda name: (name != DEFAULT, name))


def shipped_text(name: str) -> str:
    """The text of a shipped scene."""
    return (resources.files("hertzloop") / "scenes" / f"{name}.toml").read_text("utf-8")


def from_toml(text: str) -> dict[str, Any]:
    """TOML as plain data. Raises ValueError for whatever it cannot be, whatever the reason."""
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("its tables or lists are nested too deeply") from error


def toml_value(text: str) -> Any:
    """A value as written in TOML; a bare word counts as text."""
    try:
        return from_toml(f"value = {text}")["value"]
    except ValueError:
        return text.strip()


def toml_text(value: Any) -> str:
    """A value as written in TOML: what `toml_value` reads."""
    return tomli_w.dumps({"value": value}).removeprefix("value = ").strip()
