"""Which effects a run neglects: each row of `effect_rows` evaluated for a run."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from hertzloop.loop.simulate import simulate
from hertzloop.results.effect_rows import ROWS, WITHOUT_PLATE, EffectRow, RunContext
from hertzloop.results.impacts import impacts_of
from hertzloop.results.statistics import Extremes, extremes_of, stability_of
from hertzloop.scene.setup import Setup

_MOST_STEPS = 2_000_000  # that are simulated in memory


class EffectState(StrEnum):
    """What a run does with an effect."""

    WITHIN = "within"
    LEFT_OUT = "left out"
    OUT_OF_RANGE = "out of range"
    IN_THE_MODEL = "in the model"
    NOT_KNOWN = "not known"


@dataclass(frozen=True)
class ValidityCheck:
    """One effect in a run, compared with its threshold.

    Attributes:
        name: name of the effect.
        formula: formula of the value.
        value: size of the effect; nan if it is not known.
        threshold: from this value on, the effect counts as neglected; nan if it is not known.
        beyond: from this value on, the effect is out of range; inf or nan if it never is.
        state: the result of the comparison.
        sentence: the size in words.
    """

    name: str
    formula: str
    value: float
    threshold: float
    beyond: float
    state: EffectState
    sentence: str


@dataclass(frozen=True)
class Neglected:
    """The effects in a run.

    Attributes:
        context: what the effects were evaluated from; None for an unstable loop.
        checks: one for each effect that applies to the run; none for an unstable loop.
        stable: whether the loop is stable.
    """

    context: RunContext | None
    checks: Sequence[ValidityCheck] = ()
    stable: bool = True


def neglected(setup: Setup, run: Extremes) -> Neglected:
    """Evaluate all effects in a run, from its setup and largest values."""
    context = RunContext(setup, run)
    found = [
        ValidityCheck(
            row.name,
            row.formula,
            value,
            threshold,
            beyond,
            state,
            f"in the model: {part}" if part else row.words(context, value),
        )
        for row, value, threshold, beyond, part, state in _evaluated(context)
    ]
    return Neglected(context, found)


def neglected_of_scene(setup: Setup) -> Neglected:
    """Simulate a scene and evaluate all effects; of a very long scene, only the beginning."""
    setup = setup.with_steps(min(setup.run.steps, _MOST_STEPS))
    truth = simulate(setup).truth
    if stability_of(setup, truth).unstable:
        return Neglected(None, stable=False)
    with np.errstate(over="ignore", invalid="ignore"):
        impacts = [found.impact for found in impacts_of(setup, truth)]
    return neglected(setup, extremes_of(setup.plant, truth, impacts))


def names_by_state(context: RunContext) -> dict[EffectState, str]:
    """Return the names of the effects in each state, joined by commas, as in a sweep's results."""
    names: dict[EffectState, list[str]] = {}
    for row, *_, state in _evaluated(context):
        names.setdefault(state, []).append(row.name)
    return {state: ", ".join(some) for state, some in names.items()}


def _evaluated(
    context: RunContext,
) -> Iterator[tuple[EffectRow, float, float, float, str, EffectState]]:
    """Yield each row that applies, with value, threshold, start of the range, model and state."""
    if not context.touched:
        return
    for row in ROWS if context.local else WITHOUT_PLATE:
        value = row.value(context)
        if value is None:
            continue
        threshold = context.setup.run.accuracy if row.threshold is None else row.threshold
        beyond = row.beyond(context) if callable(row.beyond) else row.beyond
        part = row.modelled(context) if row.modelled is not None else ""
        if part:
            state = EffectState.IN_THE_MODEL
        elif value != value:
            state = EffectState.NOT_KNOWN
        elif value < beyond if row.falls else value > beyond:
            state = EffectState.OUT_OF_RANGE
        elif value < threshold if row.falls else value > threshold:
            state = EffectState.LEFT_OUT
        else:
            state = EffectState.WITHIN
        yield row, value, threshold, beyond, part, state
