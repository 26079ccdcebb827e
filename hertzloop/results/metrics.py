"""Metrics of a run, from its time series."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hertzloop.loop.impact_end import quiet_steps
from hertzloop.plant.metrics.impacts import Impact
from hertzloop.plant.metrics.noise import ImpactNoise
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.results.effects import Neglected, neglected
from hertzloop.results.impacts import impacts_of
from hertzloop.results.span_metrics import SpanMetrics, ValuesBySpan, by_span, of_impact, values_of
from hertzloop.results.statistics import (
    ActuatorDemand,
    ForceTiming,
    Stability,
    demand_of,
    extremes_of,
    force_timing,
    stability_of,
)
from hertzloop.results.whole_run import whole_run
from hertzloop.scene.build import free_series
from hertzloop.scene.setup import Setup


@dataclass(frozen=True)
class Metrics:
    """Metrics of a run.

    Attributes:
        impacts: the impacts, in order.
        noise: noise metrics of each impact.
        first_impact: metrics of the first impact; None without a contact.
        whole_run: metrics of all contacts; None without one, for the published scheme, and if
            steps are missing.
        last_contact_ended: whether the last contact ended within the run.
        stability: stability of the loop.
        demand: demand on the actuator; None if it never acts.
        push: when the actuator acts; None if it never acts.
        neglected: the effects that the run neglects.
    """

    impacts: list[Impact]
    noise: list[ImpactNoise]
    first_impact: SpanMetrics | None
    whole_run: SpanMetrics | None
    last_contact_ended: bool
    stability: Stability
    demand: ActuatorDemand | None
    push: ForceTiming | None
    neglected: Neglected

    @property
    def by_impact(self) -> list[dict[str, float]]:
        """The metrics of each impact by name; see `values_of`."""
        return values_of(self.impacts, self.noise)

    @property
    def by_span(self) -> ValuesBySpan:
        """The metrics of the first impact and of the whole run by name."""
        return by_span(self.first_impact, self.noise[0] if self.noise else None, self.whole_run)


@dataclass(frozen=True)
class Saturation:
    """How often samples exceeded the range of the sensor, and since when, s."""

    times: int
    since_s: float


@dataclass(frozen=True)
class RunResult:
    """The result of a run, to be assessed.

    Attributes:
        metrics: the metrics of the run.
        scene_law: the law that the scene names; None if it is not known.
        expected_error: expected model error, relative; None if it is not known.
        injected_j: work of the actuator on the plate, J.
        dent_m: permanent indentation, m.
        late: whether forces came too late, so that the law alone did not decide.
        saturation: saturation of the sensor, if any.
        complete: whether the metrics are of all steps of the run.
    """

    metrics: Metrics
    scene_law: str | None
    expected_error: float | None
    injected_j: float = 0.0
    dent_m: float = 0.0
    late: bool = False
    saturation: Saturation | None = None
    complete: bool = True


def metrics_of(setup: Setup, truth: np.ndarray, missing_from: int | None = None) -> Metrics:
    """Compute the metrics of a run.

    Args:
        setup: The setup of the run.
        truth: Its time series, shape (10, steps).
        missing_from: The step at which the time series ends too early. An impact that may last
            longer is left out, and the metrics of the whole run are unknown. None for a whole run.
    """
    spec, stability = setup.plant, stability_of(setup, truth)
    total = None
    with np.errstate(over="ignore", invalid="ignore"):  # of a loop that explodes
        found = impacts_of(setup, truth)
        if missing_from is not None:
            found = [one for one in found if one.over + quiet_steps(setup) <= missing_from]
        impacts = [one.impact for one in found]
        if SCHEMES[setup.run.scheme].conserves and missing_from is None:
            total = whole_run(spec, truth, impacts)
    effects = Neglected(None, stable=False)
    if not stability.unstable:
        effects = neglected(setup, extremes_of(spec, truth, impacts))
    return Metrics(
        impacts=impacts,
        noise=[one.noise for one in found],
        first_impact=of_impact(spec, found[0]) if found else None,
        whole_run=total,
        last_contact_ended=found[-1].ended if found else True,
        stability=stability,
        demand=demand_of(spec, truth),
        push=force_timing(spec, truth),
        neglected=effects,
    )


@lru_cache(maxsize=4)
def free_metrics(setup: Setup) -> Metrics | None:
    """Simulate the same run without control, on the same plate model; None without a law."""
    if not setup.scene.controller.has_law:
        return None
    without = setup.without_control(same_plate=True)
    return metrics_of(without, free_series(without))
