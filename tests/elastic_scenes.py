"""The shipped scenes of most tests: elastic copies, whose numbers are those of an elastic impact.

A test that names a shipped scene reads the file of this name in `scenes/shipped`, also in processes
that `tests/hertzloop/commands.py` starts, and in a pytest with `-p tests.elastic_scenes`. The
fixture `shipped_scenes` gives a test the scenes as they are shipped.
"""

from collections.abc import Iterable
from pathlib import Path

from hertzloop.scene import loading

FOLDER = Path(__file__).resolve().parent / "scenes" / "shipped"
as_shipped = loading.shipped_text


def elastic_text(name: str) -> str:
    """The text of the elastic copy of a shipped scene."""
    return (FOLDER / f"{name}.toml").read_text("utf-8")


def pytest_configure() -> None:
    """Let a shipped scene be its elastic copy."""
    loading.shipped_text = elastic_text


def with_elastic_scenes(words: Iterable[str]) -> list[str]:
    """Words of a command line, with the file of the elastic copy for the name of a scene."""
    copies = {name: str(FOLDER / f"{name}.toml") for name in loading.shipped()}
    return [copies.get(word, word) for word in words]
