"""How well the impacts of a run can be known, since each one magnifies earlier errors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hertzloop.loop.simulate import simulate
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.state_kernels import FLIGHT_V
from hertzloop.plant.time_series import F_A, F_A1, F_C, F_C1
from hertzloop.results.impacts import impacts_of
from hertzloop.results.metrics import Metrics, RunResult
from hertzloop.results.span_metrics import Values, values_of
from hertzloop.scene.build import build_plant
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


@dataclass(frozen=True)
class ImpactErrors:
    """Errors of one impact, infinite if the disturbed run has no such impact.

    Attributes:
        amplification: relative change of the most sensitive quantity over the disturbance.
        errors: error of each metric at the model's error, in the unit of the metric.
    """

    amplification: float
    errors: dict[str, float]

    @property
    def chaotic(self) -> bool:
        """Whether the impact magnifies earlier errors so much that digits are lost."""
        return not self.amplification <= CHAOTIC


def known_impacts(
    setup: Setup,
    impacts: Sequence[Values],
    model_error: float,
    in_lock_step: bool = True,
) -> list[ImpactErrors] | None:
    """Estimate the errors of the impacts of a run by simulating it again with a disturbed start.

    Args:
        setup: The setup of the run.
        impacts: The metrics of the impacts of the run, as `values_of` has them.
        model_error: Model error of the run, relative.
        in_lock_step: Whether the run was in lock-step. The impacts of a paced run differ from the
            disturbed ones for that reason alone, so that a run in lock-step replaces them.

    Returns:
        The errors of each impact; None for fewer than two impacts and for the published scheme.
    """
    if len(impacts) < 2 or not SCHEMES[setup.run.scheme].converges:
        return None
    others = _impacts(setup, DISTURBANCE)
    run = [] if in_lock_step else _impacts(setup)[: len(impacts)]
    found = []
    for i, values in enumerate([*run, *impacts[len(run) :]]):
        other = others[i] if i < len(others) else {}
        moved = {name: abs(other.get(name, np.inf) - value) for name, value in values.items()}
        share = [moved[name] / abs(values[name]) if values[name] else 0.0 for name in _QUANTITIES]
        errors = {name: value * model_error / DISTURBANCE for name, value in moved.items()}
        found.append(ImpactErrors(float(np.max(share)) / DISTURBANCE, errors))
    return found


def _truth(setup: Setup, disturbance: float = 0.0) -> np.ndarray:
    """Simulate a run, its sphere's initial speed changed by a share; time series, shape (10,
    steps)."""
    plant = build_plant(setup)
    plant.state.body[FLIGHT_V] *= 1.0 + disturbance
    return simulate(setup, own_plant=plant).truth


def _impacts(setup: Setup, disturbance: float = 0.0) -> list[Values]:
    """Simulate the impacts of a run, and return their metrics."""
    with np.errstate(over="ignore", invalid="ignore"):
        found = impacts_of(setup, _truth(setup, disturbance))
        return values_of([one.impact for one in found], [one.noise for one in found])


def errors_of(known: Sequence[ImpactErrors] | None, impact: int) -> Values:
    """Return the errors of the metrics of a chaotic impact; empty if all digits are predictable."""
    if known is None or impact >= len(known) or not known[impact].chaotic:
        return {}
    return known[impact].errors


def later_impacts_known(impacts: Sequence[Values], known: Sequence[ImpactErrors] | None) -> bool:
    """Return whether any digit of the peak force of every impact is predictable: whether that
    impact occurs at all."""
    errors = [errors_of(known, i).get("peak_force_n", 0.0) for i in range(len(impacts))]
    return all(
        error < impact["peak_force_n"] or error == 0.0
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
            impacts = _impacts(run)
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
    truth, disturbed = _truth(setup), _truth(setup, DISTURBANCE)
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
        why_not: why the run cannot be simulated again; empty if it can.
        disturbance: relative disturbance of the start.
    """

    model_error: float | None
    controlled: list[ImpactErrors] | None
    uncontrolled: list[ImpactErrors] | None
    why_not: str = ""
    disturbance: float = DISTURBANCE


def predictability(
    setup: Setup,
    result: RunResult,
    free: Metrics | None,
    why_not: str = "",
) -> Predictability:
    """Estimate how well the impacts of a run can be known.

    Args:
        setup: The setup of the run.
        result: The run. If its forces were late, the same run in lock-step is evaluated instead.
        free: Metrics of the run without control.
        why_not: Why the closed loop cannot be simulated again, if so.

    Returns:
        The errors of each impact; nothing is known of the impacts of an unstable loop.
    """
    error, without = result.expected_error, setup.without_control(same_plate=True)
    if not SCHEMES[setup.run.scheme].converges:  # no finer model tells an error from its numbers
        error = None
    own = other = None
    if not why_not and not result.metrics.stability.unstable and error is not None:
        try:
            own = known_impacts(setup, result.metrics.by_impact, error, not result.late)
        except SceneError as stopped:  # the law, in the disturbed run
            why_not = str(stopped)
    if not setup.scene.controller.has_law:
        other = own
    elif error is not None and free is not None:
        other = known_impacts(without, free.by_impact, error)
    return Predictability(error, own, other, why_not)
