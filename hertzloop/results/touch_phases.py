"""Metrics over the phase of the first touch within a step, which nobody controls.

A digital law answers in whole samples, so a metric at one phase is one end of a range: contact may
begin anywhere between two samples. A run is repeated at phases spread evenly over a step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hertzloop.loop.simulate import simulate
from hertzloop.plant.plant import modes_of
from hertzloop.results.impacts import first_impact, impacts_of
from hertzloop.results.metrics import RunResult
from hertzloop.results.predictability import Predictability, later_impacts_known
from hertzloop.results.span_metrics import ValuesBySpan, by_span, of_impact
from hertzloop.results.spans import follow
from hertzloop.results.whole_run import audible_modes, whole_run
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup

TOUCH_PHASE_KEY = "run.touch_phase"
FEW = 5

# Work of the repeats of a whole run, steps times modes: about half a second of one core.
_MOST_WORK = 2e8
_STEP_WORK = 100.0  # of a step beside its modes, in modes


def phases(count: int = FEW) -> tuple[float, ...]:
    """Return phases spread evenly over a step; an odd number of them includes the middle."""
    return tuple(round((i + 0.5) / count, 6) for i in range(count))


@dataclass(frozen=True)
class Spread:
    """Mean, least and largest value of a metric; nan if a phase has none."""

    mean: float
    least: float
    most: float

    def __str__(self) -> str:
        if np.isnan(self.mean):
            return "-"
        return f"{self.mean:z.2f} ({self.least:z.2f} to {self.most:z.2f})"


def spread_of(values: Any) -> Spread:
    """Return the spread of the values of a metric over the phases."""
    found = np.asarray(values, dtype=float)
    with np.errstate(invalid="ignore"):
        return Spread(float(np.mean(found)), float(np.min(found)), float(np.max(found)))


def at_other_phases(
    setup: Setup, result: RunResult, known: Predictability
) -> Sequence[ValuesBySpan]:
    """Repeat a run at other touch phases, in one compiled loop.

    Args:
        setup: The setup of the run.
        result: The run. If its forces were late, the changes of the same run in lock-step count.
        known: How well its impacts can be known.

    Returns:
        The metrics at each phase; none if the touch phase changes nothing, or if the run cannot be
        repeated. Those of the whole run are empty where later impacts are not predictable, and
        where the repeats take long.
    """
    metrics = result.metrics
    if (
        not setup.scene.controller.has_law
        or metrics.first_impact is None
        or metrics.stability.unstable
        or known.why_not
    ):
        return ()
    own = setup.with_plate_model(setup.plate_model)
    others = [phase for phase in phases() if abs(phase - setup.run.phase) > 1e-9]
    if own.refusal({TOUCH_PHASE_KEY: others[0]}):  # the run does not begin in flight
        return ()
    work = setup.run.steps * (len(modes_of(setup.plant).omega) + _STEP_WORK)
    whole = (
        result.complete
        and metrics.whole_run is not None
        and later_impacts_known(metrics.by_impact, known.controlled)
        and work * len(others) <= _MOST_WORK
    )
    try:
        found = [_at_phase(own, phase, whole) for phase in others]
        if result.late:
            in_lock_step = _at_phase(own, setup.run.phase, whole)
            found = [_shifted(one, in_lock_step, metrics.by_span) for one in found]
    except SceneError:  # the law stops at another phase, or a phase has no impact
        return ()
    return found


def _at_phase(setup: Setup, phase: float, whole: bool) -> ValuesBySpan:
    """Return the metrics of a run at a touch phase. Raises SceneError."""
    setup = setup.vary({TOUCH_PHASE_KEY: phase})
    truth = simulate(setup).truth if whole else follow(setup, "impact")[1].truth
    first = first_impact(setup, truth)
    if first is None:
        raise SceneError("no impact ends within the run")
    run = None
    if whole:
        found = impacts_of(setup, truth, audible_modes(setup.plant))
        run = whole_run(setup.plant, truth, [one.impact for one in found])
    return by_span(of_impact(setup.plant, first), first.noise, run)


def _shifted(found: ValuesBySpan, reference: ValuesBySpan, ran: ValuesBySpan) -> ValuesBySpan:
    """Return the metrics of a run that ran as `ran`, changed as `found` is from `reference`; what
    is positive stays so."""

    def shifted(own: float, value: float, lock_step: float) -> float:
        changed = own + value - lock_step
        return max(changed, 0.0) if min(own, value, lock_step) >= 0.0 else changed

    return {
        span: {k: shifted(ran[span][k], v, reference[span][k]) for k, v in values.items()}
        for span, values in found.items()
    }
