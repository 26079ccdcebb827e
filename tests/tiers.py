"""Which cases of a test belong to the default tier."""

from collections.abc import Container, Iterable
from typing import Any

import pytest


def default(values: Iterable[Any], quick: Container[Any]) -> list[Any]:
    """Parameters of a test: those in `quick` belong to the default tier, the others to `--all`."""
    return [
        value if value in quick else pytest.param(value, marks=pytest.mark.full) for value in values
    ]
