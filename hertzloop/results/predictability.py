"""How well each impact of a run can be known: the run again, disturbed a little at its start.

A bounce on a vibrating plate depends on the plate's phase at the touch, so that later impacts may
magnify what came before them a hundredfold each. What a disturbance of 1e-9 grows to tells by how
much the model's own error grows, and what two processors that round differently may differ by.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hertzloop.loop.compiled import closed_loop_rows
from hertzloop.results.impact_rows import F_A, F_A1, F_C, F_C1, impacts_of_blocks
from hertzloop.setup import Setup
from plant.schemes.registry import SCHEMES

DISTURBANCE = 1e-9  # of the sphere's speed at the start
# What rounding does is as if the start differed by 2e-16 to 6e-16 (measured between a processor
# with fused multiply-add and one without, three scenes); with a margin of more than ten.
ROUNDING = 1e-14
CHAOTIC = 10.0  # times as large as the disturbance: what came before decides
_QUANTITIES = (
    "start_s", "duration_s", "impact_speed_m_s", "rebound_speed_m_s", "peak_force_n",
    "plate_energy_j",
)  # fmt: skip
_FOLLOWS = ("plate_speed_max_m_s",)  # with waves that samples hardly carry: says little of chaos


@dataclass(frozen=True)
class Known:
    """Of one impact: how often the disturbance is found in the quantity that moved most, relative
    to it, and by how much each quantity, and each of its noise figures, may be wrong at the model's
    error, in its unit; infinite where the disturbed run has no such impact."""

    amplification: float
    errors: dict[str, float]
    noise_errors: dict[str, float]


def known_impacts(
    setup: Setup,
    impacts: list[dict[str, float]],
    model_error: float,
    in_lock_step: bool = True,
    noise: list[dict[str, float]] | None = None,
) -> list[Known] | None:
    """What can be known of the impacts of a run, and of their `noise` figures; None where nothing
    can depend on an impact before, and of the published scheme. `model_error`: relative, of the
    run. A run that was not `in_lock_step` has other impacts than the disturbed one for that reason
    alone: each is known as well as the same one in lock-step."""
    if len(impacts) < 2 or not SCHEMES[setup.scheme].converges:
        return None
    others = _impacts(setup, DISTURBANCE)
    run = [] if in_lock_step else _impacts(setup)[: len(impacts)]
    recorded = list(zip(impacts, noise or [{}] * len(impacts), strict=True))
    found = []
    for i, (impact, sound) in enumerate([*run, *recorded[len(run) :]]):
        other_impact, other_sound = others[i] if i < len(others) else ({}, {})
        moved = _moved(impact, other_impact, (*_QUANTITIES, *_FOLLOWS))
        share = [moved[name] / abs(impact[name]) if impact[name] else 0.0 for name in _QUANTITIES]
        errors, noise_errors = (
            {name: value * model_error / DISTURBANCE for name, value in each.items()}
            for each in (moved, _moved(sound, other_sound, sound))
        )
        found.append(Known(float(np.max(share)) / DISTURBANCE, errors, noise_errors))
    return found


def _moved(
    figures: dict[str, float], others: dict[str, float], names: Iterable[str]
) -> dict[str, float]:
    """By how much figures differ; infinite where the others have none."""
    return {name: abs(others.get(name, np.inf) - figures[name]) for name in names}


def _impacts(
    setup: Setup, disturbance: float = 0.0
) -> list[tuple[dict[str, float], dict[str, float]]]:
    """Impacts of a run with their noise figures, fields as in `Impact` and `ImpactNoise`."""
    with np.errstate(over="ignore", invalid="ignore"):
        found = impacts_of_blocks(setup, closed_loop_rows(setup, disturbance))
        return [(vars(one.impact), vars(one.noise)) for one in found]


def as_dicts(known: list[Known] | None) -> list[dict[str, Any]] | None:
    """For --json."""
    return None if known is None else [vars(each) for each in known]


def is_chaotic(known: dict[str, Any]) -> bool:
    """Whether an impact, fields as in `Known`, depends on what was before it by far too much."""
    return not known["amplification"] <= CHAOTIC


def errors_of(
    known: list[dict[str, Any]] | None, impact: int, of: str = "errors"
) -> dict[str, float]:
    """Errors of the figures of an impact that is chaotic, or of its noise (`noise_errors`); empty
    where all digits count."""
    if known is None or impact >= len(known) or not is_chaotic(known[impact]):
        return {}
    return dict(known[impact][of])


def horizon_step(setup: Setup, tolerance: float) -> int | None:
    """First step at which two processors may differ by more than `tolerance` of a field's largest
    value, None if they agree to the end. Raises SceneError where the scene cannot be simulated."""
    if not SCHEMES[setup.scheme].converges:
        return None
    allowed = tolerance * DISTURBANCE / ROUNDING
    largest = 0.0 * next(closed_loop_rows(setup))[1][:, 0]
    for _, rows in closed_loop_rows(setup):
        largest = np.maximum(largest, np.abs(rows).max(axis=1))
    largest[[F_C1, F_A1]] = largest[[F_C, F_A]]  # slopes are as exact as their forces
    largest[largest == 0.0] = 1.0
    both = zip(closed_loop_rows(setup), closed_loop_rows(setup, DISTURBANCE), strict=True)
    for (first, rows), (_, disturbed) in both:
        apart = np.max(np.abs(rows - disturbed) / largest[:, None], axis=0)
        beyond = np.flatnonzero(~(apart <= allowed))
        if len(beyond):
            return first + int(beyond[0])
    return None
