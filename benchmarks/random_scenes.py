"""Random scenes: how they are drawn one by one, and how their keys are written."""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from benchmarks.program import progress

Found = TypeVar("Found")


def drawn(
    scenes: int, seed: int, outcomes: Callable[[int, np.random.Generator], list[Found]]
) -> list[Found]:
    """Outcomes of `scenes` random scenes; one that has none is drawn anew.

    Args:
        scenes: number of scenes.
        seed: of the generator that draws them.
        outcomes: draws a scene by its number and the generator, and returns what is found of it.
    """
    random = np.random.default_rng(seed)
    found: list[Found] = []
    number = 0
    with progress("random scenes", scenes) as advance:
        while number < scenes:
            its = outcomes(number, random)
            number += bool(its)
            found += its
            advance(number)
    return found


def typed(value: Any) -> Any:
    """A value of a key with the digits that a person types."""
    if isinstance(value, list):
        return [typed(x) for x in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def as_options(keys: dict[str, Any]) -> str:
    """Keys of a scene as options of the command line."""
    return " ".join(f"--set {key}={value}".replace(", ", ",") for key, value in keys.items())
