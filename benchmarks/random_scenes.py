"""Random scenes: how they are drawn one by one, how their keys are written, and their first impact
against that of a finer model."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from benchmarks.program import progress
from benchmarks.scenes import load
from hertzloop.loop.simulate import simulate
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.results.verification import Verification, against
from hertzloop.scene.setup import Setup

Found = TypeVar("Found")
LEAD_S = 1e-5


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


def first_impact_of(keys: dict[str, Any], accuracy: float) -> Setup:
    """A changed `aluminium-3mm` by its modes, which lasts as long as its first impact."""
    run = {"run.lead_in_s": LEAD_S, "run.plate_model": "modal", "run.accuracy": accuracy}
    setup = load("aluminium-3mm").vary(keys | run)
    lasts_s = rigid_impact(setup.mechanics.sphere, setup.mechanics.contact).contact_s
    return setup.with_steps(round((LEAD_S + 5.0 * lasts_s + 4e-5) / setup.run.step_s))


def errors_of(setup: Setup, limit_hz: float) -> Verification | None:
    """Errors of the first impact against modes up to `limit_hz` and half the step; None if it does
    not end in time."""
    fine = replace(setup.plant, step_s=setup.run.step_s / 2, frequency_limit_hz=limit_hz)
    with np.errstate(over="ignore", invalid="ignore"):
        return against(setup, simulate(setup).truth, fine)
