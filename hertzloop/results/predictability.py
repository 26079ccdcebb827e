"""How well the impacts of a run can be known, since each one magnifies earlier errors."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from hertzloop.loop.simulate import closed_loop_truth
from hertzloop.plant.metrics.impacts import Impact
from hertzloop.plant.metrics.noise import ImpactNoise
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.time_series import F_A, F_A1, F_C, F_C1
from hertzloop.results.impacts import impacts_of
from hertzloop.results.metrics import Metrics, RunResult
from hertzloop.results.repeatability import NotRepeatable, WhyNotRepeatable
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup

# A bounce on a vibrating plate depends on the plate's phase at the touch, so that later impacts may
# magnify what came before them a hundredfold each. What a disturbance of 1e-9 grows to tells by how
# much the model's own error grows, and what two processors that round differently may differ by.
DISTURBANCE = 1e-9  # of the sphere's speed at the start

# What rounding does is as if the start differed by 2e-16 to 6e-16 (measured between a processor
# with fused multiply-add and one without, three scenes); with a margin of more than ten.
ROUNDING = 1e-14

CHAOTIC = 10.0  # times as large as the disturbance: what came before decides

_QUANTITIES = (
    "start_s",
    "duration_s",
    "impact_speed_m_s",
    "rebound_speed_m_s",
    "peak_force_n",
    "plate_energy_j",
)

# Which impacts decide a metric of the whole run; energies are those of all.
_OF_FIRST = ("contact_time_s", "impact_speed_m_s", "holmes_j")
_OF_LAST = ("rebound_speed_m_s", "rebound_height_m", "longhorn_j")
_LARGEST = ("peak_force_n", "plate_speed_max_m_s", "peak_pressure_pa")

_FOLLOWS = ("plate_speed_max_m_s",)  # with waves that samples hardly carry: says little of chaos


@dataclass(frozen=True)
class ImpactErrors:
    """Errors of one impact, infinite if the disturbed run has no such impact.

    Attributes:
        amplification: relative change of the most sensitive quantity over the disturbance.
        errors: error of each quantity at the model's error, in the unit of the quantity.
        noise_errors: the same for each noise metric.
    """

    amplification: float
    errors: dict[str, float]
    noise_errors: dict[str, float]

    @property
    def chaotic(self) -> bool:
        """Whether the impact magnifies earlier errors so much that digits are lost."""
        return not self.amplification <= CHAOTIC


def known_impacts(
    setup: Setup,
    impacts: Sequence[Impact],
    model_error: float,
    in_lock_step: bool = True,
    noise: Sequence[ImpactNoise] = (),
) -> list[ImpactErrors] | None:
    """Estimate the errors of the impacts of a run by simulating it again with a disturbed start.

    Args:
        setup: The setup of the run.
        impacts: The impacts of the run.
        model_error: Model error of the run, relative.
        in_lock_step: Whether the run was in lock-step. The impacts of a paced run differ from the
            disturbed ones for that reason alone, so that a run in lock-step replaces them.
        noise: Noise metrics of the impacts.

    Returns:
        The errors of each impact; None for fewer than two impacts and for the published scheme.
    """
    if len(impacts) < 2 or not SCHEMES[setup.run.scheme].converges:
        return None
    others = _impacts(setup, DISTURBANCE)
    run = [] if in_lock_step else _impacts(setup)[: len(impacts)]
    sounds = map(vars, noise) if noise else [{}] * len(impacts)
    recorded = list(zip(map(vars, impacts), sounds, strict=True))
    found = []
    for i, (impact, sound) in enumerate([*run, *recorded[len(run) :]]):
        other_impact, other_sound = others[i] if i < len(others) else ({}, {})
        moved = _moved(impact, other_impact, (*_QUANTITIES, *_FOLLOWS))
        share = [moved[name] / abs(impact[name]) if impact[name] else 0.0 for name in _QUANTITIES]
        errors, noise_errors = (
            {name: value * model_error / DISTURBANCE for name, value in each.items()}
            for each in (moved, _moved(sound, other_sound, sound))
        )
        found.append(ImpactErrors(float(np.max(share)) / DISTURBANCE, errors, noise_errors))
    return found


def _moved(
    metrics: dict[str, float], others: dict[str, float], names: Iterable[str]
) -> dict[str, float]:
    """Return by how much metrics differ; infinite if the others have no such metric."""
    return {name: abs(others.get(name, np.inf) - metrics[name]) for name in names}


def _time_series(setup: Setup, disturbance: float = 0.0) -> np.ndarray:
    """Simulate a scene with its law; shape (10, steps). Raises SceneError if the law fails."""
    return np.concatenate([part for _, part in closed_loop_truth(setup, disturbance)], axis=1)


def _impacts(
    setup: Setup, disturbance: float = 0.0
) -> list[tuple[dict[str, float], dict[str, float]]]:
    """Simulate impacts and their noise metrics, with fields as in `Impact` and `ImpactNoise`."""
    with np.errstate(over="ignore", invalid="ignore"):
        found = impacts_of(setup, _time_series(setup, disturbance))
        return [(vars(one.impact), vars(one.noise)) for one in found]


def errors_of(
    known: Sequence[ImpactErrors] | None, impact: int, of: str = "errors"
) -> dict[str, float]:
    """Return the errors of a chaotic impact, `of` its metrics ("errors") or its noise
    ("noise_errors"); empty if all digits are predictable."""
    if known is None or impact >= len(known) or not known[impact].chaotic:
        return {}
    return dict(getattr(known[impact], of))


def error_of(known: Sequence[ImpactErrors] | None, span: str, key: str) -> float:
    """Return the largest absolute error of a metric of `SpanMetrics`.

    Args:
        known: Errors of each impact of the run; None if they are not known.
        span: "first_impact" or "whole_run".
        key: Name of the metric.

    Returns:
        The error in the unit of the metric; 0 if all digits are predictable.
    """
    each = [
        (errors_of(known, i) | errors_of(known, i, "noise_errors")).get(key, 0.0)
        for i in range(len(known or ()))
    ]
    if span == "first_impact" or key in _OF_FIRST:
        each = each[:1]
    elif key in _OF_LAST:
        each = each[-1:]
    return max(each, default=0.0) if key in _LARGEST else sum(each)


def later_impacts_known(impacts: Sequence[Impact], known: Sequence[ImpactErrors] | None) -> bool:
    """Return whether any digit of the peak force of every impact is predictable: whether that
    impact occurs at all."""
    errors = [errors_of(known, i).get("peak_force_n", 0.0) for i in range(len(impacts))]
    return all(
        error < impact.peak_force_n or error == 0.0
        for error, impact in zip(errors, impacts, strict=True)
    )


def whole_run_known(setup: Setup) -> bool:
    """Return whether every impact of a run is predictable, and every one of the same run without
    control.

    Both are simulated twice. The requested accuracy stands for the model error. False where the law
    stops in a repeat.
    """
    try:
        for run in (setup, setup.without_control(same_plate=True)):
            impacts = [one.impact for one in impacts_of(run, _time_series(run))]
            known = known_impacts(run, impacts, setup.run.accuracy)
            if not later_impacts_known(impacts, known):
                return False
    except SceneError:
        return False
    return True


def horizon_step(setup: Setup, tolerance: float) -> int | None:
    """Return the first step at which two processors may differ by more than `tolerance` of a
    field's largest value; None if they agree to the end. Raises SceneError."""
    if not SCHEMES[setup.run.scheme].converges:
        return None
    allowed = tolerance * DISTURBANCE / ROUNDING
    truth, disturbed = _time_series(setup), _time_series(setup, DISTURBANCE)
    largest = np.abs(truth).max(axis=1)
    largest[[F_C1, F_A1]] = largest[[F_C, F_A]]  # slopes are as exact as their forces
    largest[largest == 0.0] = 1.0
    beyond = np.zeros(truth.shape[1], bool)
    for row, other, most in zip(truth, disturbed, largest, strict=True):
        beyond |= ~(np.abs(row - other) / most <= allowed)
    return int(np.argmax(beyond)) if beyond.any() else None


@dataclass(frozen=True)
class Predictability:
    """How well the impacts of a run can be known.

    Attributes:
        model_error: model error of the run, relative; None if it is not known.
        controlled: errors of each impact of the run; None if no impact magnifies earlier errors, or
            nothing is known.
        uncontrolled: the same for the run without control.
        not_repeatable: why the run cannot be simulated again; None if it can.
        disturbance: relative disturbance of the start.
    """

    model_error: float | None
    controlled: list[ImpactErrors] | None
    uncontrolled: list[ImpactErrors] | None
    not_repeatable: NotRepeatable | None = None
    disturbance: float = DISTURBANCE


NOTHING_KNOWN = Predictability(None, None, None)


def predictability(
    setup: Setup,
    result: RunResult,
    free: Metrics | None,
    not_repeatable: NotRepeatable | None = None,
) -> Predictability:
    """Estimate how well the impacts of a run can be known.

    Args:
        setup: The setup of the run.
        result: The run. If its forces were late, the same run in lock-step is evaluated instead.
        free: Metrics of the run without control.
        not_repeatable: Why the closed loop cannot be simulated again, if so.

    Returns:
        The errors of each impact; nothing is known of the impacts of an unstable loop.
    """
    error, without = result.expected_error, setup.without_control(same_plate=True)
    if not SCHEMES[setup.run.scheme].converges:  # no finer model tells an error from its numbers
        error = None
    own = other = None
    if not not_repeatable and not result.metrics.stability.unstable and error is not None:
        own_metrics = result.metrics
        try:
            own = known_impacts(
                setup, own_metrics.impacts, error, not result.late, own_metrics.noise
            )
        except SceneError as stopped:  # the law, in the disturbed run
            not_repeatable = NotRepeatable(WhyNotRepeatable.LAW_STOPPED, error=str(stopped))
    if not setup.scene.controller.has_law:
        other = own
    elif error is not None and free is not None:
        other = known_impacts(without, free.impacts, error, noise=free.noise)
    return Predictability(error, own, other, not_repeatable)
