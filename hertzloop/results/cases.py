"""One case of a sweep: a scene simulated in one compiled call, and its metrics."""

import hashlib
import math
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from operator import attrgetter
from typing import Any

import numpy as np

from hertzloop.controller.law import ACTING
from hertzloop.loop.simulate import LawStopped, SimulatedRun
from hertzloop.plant.metrics.impacts import Impact
from hertzloop.results.effect_rows import RunContext
from hertzloop.results.effects import EffectState, names_by_state
from hertzloop.results.facts import Level, described, fact, facts_of
from hertzloop.results.impacts import ImpactMetrics, first_impact, impacts_of
from hertzloop.results.span_metrics import SPAN_FACTS, SpanMetrics, decibels, of_impact
from hertzloop.results.spans import Span, follow
from hertzloop.results.statistics import Stability, extremes_of, stability_of
from hertzloop.results.whole_run import audible_modes, whole_run
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.rules import check_conserves
from hertzloop.scene.setup import Resolvable, Setup, resolve


class CaseState(StrEnum):
    """What became of a case."""

    METRICS = "metrics"
    UNSTABLE = "unstable"  # it was run, but its metrics would say nothing
    NOT_RUN = "not run"  # the scene or the law refuses the values
    FAILED = "failed"  # the law, or the program, failed in the run


class UnstableLoop(SceneError):
    """The loop is unstable: the actuator adds energy without bound, so there are no metrics."""


class CaseFailed(SceneError):
    """A case failed in its run. That says nothing about the values that were tried."""

    exit_status = 1


@dataclass(frozen=True)
class _Case:
    """What the metrics of a case are taken from, `free` without control; effects by state."""

    setup: Setup
    run: SimulatedRun
    metrics: SpanMetrics
    first: ImpactMetrics
    free: SpanMetrics
    stability: Stability
    effects: dict[EffectState, str]


def _rebound_percent(case: _Case) -> float:
    """Of a rebound within the model's error nothing is a share that could be known."""
    plant, found, free = case.setup.plant, case.metrics, case.free
    if not free.rebound_speed_m_s > case.setup.run.accuracy * plant.sphere.impact_speed_m_s:
        return math.nan
    return 100.0 * found.rebound_height_m / free.rebound_height_m


def _impulse_n_s(case: _Case) -> float:
    """The force of a step is its mean, so the sum is exact."""
    return float(case.first.contact_n.sum()) * case.setup.run.step_s


def _change_of(name: str, shown: bool = False) -> Any:
    """The fact that is the change of another one against no control, dB."""
    about, value = SPAN_FACTS[name], attrgetter(name)
    return fact(f"change of the {about.label}, dB", about.label, "dB", about.db,
                of=lambda case: decibels(value(case.metrics), value(case.free), about.db),
                level=Level.BRIEF if shown else Level.DATA,
                less_is_better=True)  # fmt: skip


def _same(name: str, unit: str = "", factor: float = 1.0) -> Any:
    """The fact that is one of the span, in another unit."""
    about = SPAN_FACTS[name]
    if not unit:
        of = attrgetter(f"metrics.{name}")
        return fact(**vars(about) | {"of": of, "level": Level.DATA})
    meaning = f"{about.meaning.rpartition(',')[0]}, {unit}"
    return fact(
        meaning, about.label, unit, less_is_better=about.less_is_better,
        of=lambda case: factor * getattr(case.metrics, name),
    )  # fmt: skip


@described
@dataclass(frozen=True)
class CaseMetrics:
    """Metrics of a case of a sweep.

    Metrics in dB compare with the same span without control, on the same plate model: 10 lg of an
    energy ratio, 20 lg of a ratio of speeds or pressures.
    """

    # fmt: off
    plate_energy_db: float = _change_of("plate_energy_j", shown=True)
    rebound_percent: float = fact(
        "rebound height over that without control, %", "rebound height", "%", of=_rebound_percent,
        level=Level.BRIEF, without=100.0, less_is_better=True)
    radiated_db: float = _change_of("radiated_j", shown=True)
    plate_speed_db: float = _change_of("plate_speed_max_m_s", shown=True)
    pressure_db: float = _change_of("peak_pressure_pa", shown=True)
    longhorn_db: float = _change_of("longhorn_j")
    holmes_db: float = _change_of("holmes_j")
    plate_energy_j: float = _same("plate_energy_j")
    injected_j: float = fact("work of the actuator force on the plate, J",
                             of=attrgetter("run.balance.injected_j"))
    pumps: bool = fact("whether the actuator had at some time added more than the energy of the "
                       "impact", of=attrgetter("stability.pumps"))
    impact_energy_j: float = fact("energy of the sphere before the impact, J",
                                  of=attrgetter("run.balance.energy_start_j"))
    rebound_m_s: float = _same("rebound_speed_m_s")
    rebound_height_mm: float = _same("rebound_height_m", "mm", 1e3)
    contact_us: float = _same("contact_time_s", "us", 1e6)
    impulse_n_s: float = fact("impulse of the contact force in the first contact, N s",
                              "impulse of the first contact", "N s", of=_impulse_n_s,
                              less_is_better=True)
    contacts: int = _same("contacts")
    peak_force_n: float = _same("peak_force_n")
    delay_us: float = fact("delay that the law latched, us; nan without one",
                           of=lambda case: latched_us(case.setup, case.run))
    energy_residual: float = fact("missing part of the energy balance, relative",
                                  of=attrgetter("run.balance.energy_residual"))
    plate_model: str = fact('"modal" or "infinite"; with this value of run.plate_model, '
                            "`hertzloop run` gives the same metrics",
                            of=attrgetter("setup.scene.run.plate_model"))
    leaves_out: str = fact("names of indicators above their threshold "
                           "(`hertzloop.results.effects`)",
                           of=lambda case: case.effects.get(EffectState.LEFT_OUT, ""))
    out_of_range: str = fact("names of indicators beyond the range of the model",
                             of=lambda case: case.effects.get(EffectState.OUT_OF_RANGE, ""))
    steps: int = fact("number of simulated steps", of=lambda case: case.run.truth.shape[1])
    digest: str = fact("digest of all samples and states of these steps",
                       of=lambda case: digest_of(case.run.truth, case.run.samples))
    # fmt: on


CASE_FACTS = facts_of(CaseMetrics)
SHOWN = tuple(name for name, one in CASE_FACTS.items() if one.level is Level.BRIEF)
OBJECTIVES = tuple(name for name, one in CASE_FACTS.items() if one.less_is_better)


def digest_of(truth: np.ndarray, samples: np.ndarray) -> str:
    """Digest of truth, shape (10, steps), and samples (values, or codes): 32 hex digits, the same
    for the same bits."""
    digest = hashlib.sha256()  # processors have instructions for it
    for values in (truth, samples):
        digest.update(np.ascontiguousarray(values))
    return digest.hexdigest()[:32]


def latched_us(setup: Setup, run: SimulatedRun) -> float:
    """The first delay that the law of a run latched, us; nan of one that latches none."""
    acting = np.flatnonzero(run.modes == ACTING)
    if not len(acting) or not loaded_law(setup).latches:
        return math.nan
    return float(run.delays[acting[0]]) * setup.sensor.every_steps * setup.run.step_ns / 1000


def metrics_of_case(setup: Setup, span: Span = "impact") -> CaseMetrics:
    """Simulate a scene and compare it with the same without control.

    `span`: "impact" for the first impact (see `plant.metrics.impact_kernels`), "run" for all.
    Raises SceneError for the published scheme and for a run without contact; LawStopped for a law
    that fails; CaseFailed for numbers that are not finite; UnstableLoop, also where the law fails
    since the loop has run away.
    """
    check_conserves(setup.run.scheme)
    try:
        setup, run = follow(setup, span)
    except LawStopped as error:
        # A loop that has run away for long enough commands what is no number any more.
        _bounded(setup, error.truth)
        raise
    found = _bounded(setup, run.truth)
    if not (np.isfinite(run.truth).all() and math.isfinite(run.balance.energy_residual)):
        raise CaseFailed("the run has numbers that are not finite; its metrics would say nothing")
    metrics, impacts, end = _metrics(setup, span, run.truth)
    left_out = _left_out(setup, run.truth[:, :end], [one.impact for one in impacts])
    free = uncontrolled(setup, span)
    case = _Case(setup, run, metrics, impacts[0], free, found, left_out)
    return CaseMetrics(*(one.of(case) for one in CASE_FACTS.values() if one.of))


def _bounded(setup: Setup, truth: np.ndarray) -> Stability:
    """What truth say of the closed loop. Raises UnstableLoop."""
    found = stability_of(setup, truth)
    if found.unstable:
        times = found.most_injected
        raise UnstableLoop(
            "the closed loop is unstable: the actuator exchanges "
            + (f"{times:.3g} times the" if math.isfinite(times) else "no finite multiple of the")
            + " energy of the impact"
        )
    return found


def uncontrolled(setup: Setup, span: Span) -> SpanMetrics:
    """Return the metrics of a span of a scene without control. Raises SceneError."""
    return _uncontrolled(setup.plant_only(), span)


@lru_cache(maxsize=64)
def _uncontrolled(free: Resolvable, span: Span) -> SpanMetrics:
    setup, run = follow(resolve(free), span)
    return _metrics(setup, span, run.truth)[0]


def _left_out(setup: Setup, truth: np.ndarray, impacts: list[Impact]) -> dict[EffectState, str]:
    extremes = extremes_of(setup.plant, truth, impacts)
    return names_by_state(RunContext(setup, extremes, truth.shape[1] * setup.run.step_s))


def _metrics(
    setup: Setup, span: Span, truth: np.ndarray
) -> tuple[SpanMetrics, list[ImpactMetrics], int]:
    """Metrics of a span, the impacts in it, and the step at which it ends. Of the forces' spectrum
    what is audible counts alone: no metric of a case asks for more."""
    spec, modes = setup.plant, audible_modes(setup.plant)
    if span == "impact":
        first = first_impact(setup, truth, modes)
        found = [first] if first else []
    else:
        found = impacts_of(setup, truth, modes)
    if not found:
        raise SceneError(
            f"run.duration_s = {setup.run.duration_s:g} ends before the first contact. Increase "
            f"it, or reduce run.lead_in_s = {setup.run.lead_in_s:g}"
        )
    if span == "impact":
        return of_impact(spec, found[0]), found, found[0].over
    whole = whole_run(spec, truth, [one.impact for one in found])
    assert whole is not None
    return whole, found, truth.shape[1]
