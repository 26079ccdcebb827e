"""Fit scene keys to records."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hertzloop.identification.fit.assessment import ModelAssessment, assess_model
from hertzloop.identification.fit.control_keys import is_control_key
from hertzloop.identification.fit.errors import FitError
from hertzloop.identification.fit.free_keys import FreeKey, refuse_duplicates
from hertzloop.identification.fit.frozen_models import refreeze
from hertzloop.identification.fit.hit_speeds import add_hit_speeds
from hertzloop.identification.fit.hold_out import compare_hold_out, split_hold_out
from hertzloop.identification.fit.intervals import add_whole_step_estimate, estimate_keys
from hertzloop.identification.fit.iterate import Iterate
from hertzloop.identification.fit.key_values import values_for_record
from hertzloop.identification.fit.minimise import minimise
from hertzloop.identification.fit.prepare import prepare_problem
from hertzloop.identification.fit.problem import FitProblem
from hertzloop.identification.fit.residuals import impact_speeds, note_other_impact, residual_curves
from hertzloop.identification.fit.results import FitResult
from hertzloop.identification.fit.sample_selection import exclude_contact
from hertzloop.identification.fit.search import (
    best_start,
    search_lower_minimum,
    shifts_beyond_noise,
)
from hertzloop.identification.fit.solution import Solution, solve_with_model_errors
from hertzloop.identification.fit.summary import (
    check_sample_count,
    collect_notes,
    common_fields,
    unique_names,
)
from hertzloop.identification.fit.uncertainty import (
    KeyUncertainty,
    bootstrap_covariance,
    key_uncertainty,
)
from hertzloop.identification.fit.verdicts import KeyVerdict, ModelVerdict
from hertzloop.identification.fit.whole_steps import search_whole_steps
from hertzloop.identification.hits.split import split_hits
from hertzloop.identification.records.chain_keys import is_chain_key
from hertzloop.identification.records.record import Record
from hertzloop.scene.setup import Setup

_REFREEZE = 0.01  # change of a key's logarithm for which the model is frozen anew
_LAST_STAGES = 2  # minimisations after the windows, for the estimate of the time left
_LEAST_DRAWN = 0.25  # of a variance
_HELD_OUT = 2.0  # residual of held-out records over their noise, above which a model does not fit


def fit(
    setup: Setup,
    records: Sequence[Record],
    free: Sequence[FreeKey],
    hold_out: Sequence[Record | int] | None = None,
    on_progress: Callable[[int, int], None] = lambda done, expected: None,
    exact: bool = False,
) -> FitResult:
    """Fit scene keys to records.

    Args:
        setup: the scene to start from, in which everything else is known.
        records: at least one; all share the keys.
        free: the keys to find.
        hold_out: records, or numbers of hits, that are only compared with the result; the last one
            of several hits if left out.
        on_progress: is told the number of simulations done and of those expected.
        exact: whether the model is taken as exact, so that only noise may spoil a record.

    Returns:
        Estimates with 95 % intervals, verdicts, and the fitted setup.

    Raises:
        RecordError: a record cannot be used.
        SceneError: the scene cannot be simulated.
        FitError: the question makes no sense.
    """
    if not records:
        raise FitError("no record is given. Give at least one.")
    if not free:
        raise FitError("no key is free. Name at least one with --free KEY.")
    refuse_duplicates(free)
    began = time.perf_counter()
    records = split_hits(unique_names(records), setup)
    records, held_records = split_hold_out(records, hold_out, setup)
    free = add_hit_speeds(setup, records, free)
    problem = prepare_problem(setup, records, free)
    problem.counter.on_progress = on_progress
    windows = _fit_growing_windows(problem)
    problem = _refreeze_if_moved(setup, windows)
    until_s = problem.windows_s()[-1]
    for c, model in zip(problem.channels, problem.models, strict=True):
        exclude_contact(c, model.contact_s)  # only now: the early windows hold little else
    solution, shifts = _solve(problem, windows, until_s, exact)
    problem, iterate = solution.problem, solution.iterate
    check_sample_count(iterate)
    known = key_uncertainty(problem, iterate, shifts)
    _apply_bootstrap(known, bootstrap_covariance(problem, iterate, until_s))
    estimates, one_sided = estimate_keys(problem, iterate, known, until_s)
    estimates = add_whole_step_estimate(problem, estimates, known, solution.profile)
    unsure = {e.key for e in estimates if e.verdict is KeyVerdict.NOT_IDENTIFIABLE}
    plain = problem.evaluate(iterate.x, until_s, early=False, jacobian=False, exact=True)
    assessment = assess_model(problem, plain, until_s, one_sided | unsure)
    values = problem.key_values(iterate.x)
    fitted = _fitted_setup(setup, values, records[0])
    held = None
    if held_records:
        held = compare_hold_out(fitted, _under_same_law(held_records, free), free, exact)
    curves = residual_curves(problem, plain, until_s)
    _add_reasons(assessment, problem, curves, held, bool(unsure))
    return FitResult(
        **common_fields(problem, iterate, plain, until_s, known, assessment),
        estimates=estimates,
        hold_out=held,
        evaluations=problem.counter.done,
        setup=fitted,
        curves=curves,
        wall_s=time.perf_counter() - began,
        notes=collect_notes(problem, setup),
        speeds_m_s=impact_speeds(problem, values),
        records=list(records),
    )


@dataclass
class _WindowsFit:
    """Solution of growing windows: the iterate of the whole record, and of each shorter window its
    end after the touch (s) and its parameters."""

    problem: FitProblem
    iterate: Iterate
    shorter: list[tuple[float, np.ndarray]]


def _fit_growing_windows(problem: FitProblem) -> _WindowsFit:
    """Fit the keys to growing parts of the records, each from the solution of the one before."""
    counter, keys = problem.counter, len(problem.varied_keys)
    if problem.looped:
        problem = search_whole_steps(problem)
    x = best_start(problem)
    *early_ends, until_s = ends = problem.windows_s()
    shorter = []
    for i, end in enumerate(early_ends):
        counter.expect(len(ends) - i + _LAST_STAGES, keys)
        x = minimise(problem, x, end, early=True, steps=15, tolerance=1e-3).x
        shorter.append((end, x))
    counter.expect(1 + _LAST_STAGES, keys)
    iterate = minimise(problem, x, until_s, early=False, steps=15, tolerance=1e-3)
    counter.expect(_LAST_STAGES, keys)
    if not problem.looped:
        iterate = search_lower_minimum(problem, iterate, ends)
    return _WindowsFit(problem, iterate, shorter)


def _refreeze_if_moved(setup: Setup, windows: _WindowsFit) -> FitProblem:
    """Return the problem, with new frozen models if a key has moved."""
    problem, x = windows.problem, windows.iterate.x
    starts = [math.log(f.start) for f in problem.varied_keys]
    if max((abs(v - s) for s, v in zip(starts, x, strict=False)), default=0.0) <= _REFREEZE:
        return problem
    return refreeze(setup, problem, windows.iterate)


def _solve(
    problem: FitProblem, windows: _WindowsFit, until_s: float, exact: bool
) -> tuple[Solution, list[np.ndarray]]:
    """Return the solution of the whole records, and how far its keys are from those of shorter
    windows beyond noise.

    Without a model error in the problem the whole record may have bent the keys too far. So, where
    the solution has one, it is also sought from the solution of the first window.
    """
    problem.counter.expect(1, len(problem.varied_keys))
    found = solve_with_model_errors(problem, windows.iterate, until_s, exact)
    if not found.has_model_error:
        return found, []
    if windows.shorter and not problem.looped:
        again = problem.evaluate(windows.shorter[0][1], until_s, early=False)
        other = solve_with_model_errors(problem, again, until_s, exact)
        found = min(found, other, key=lambda one: one.cost)
    return found, shifts_beyond_noise(problem, windows.shorter, found.iterate)


def _apply_bootstrap(known: KeyUncertainty, drawn: np.ndarray | None) -> None:
    """Use the covariance of draws; but never less than half the standard deviation that white noise
    of the same size would give."""
    if drawn is None:
        return
    least = float(np.max(np.diag(known.covariance) / np.diag(drawn)))
    if math.isfinite(least):
        known.covariance = drawn * max(1.0, _LEAST_DRAWN * least)


def _fitted_setup(setup: Setup, values: dict[str, float], first: Record) -> Setup:
    """Return the setup with the fitted values; of the speeds of hits it takes that of the first."""
    for of_sensor in (False, True):
        changed = {
            name: value
            for key, value in values.items()
            if is_chain_key(key) is of_sensor
            for name in (key, *values_for_record({key: value}, first))
            if "[" not in name
        }
        setup = setup.vary(changed)
    return setup


def _under_same_law(records: Sequence[Record], free: Sequence[FreeKey]) -> list[Record]:
    """The records, which are under the law if a key of it is free and they do not say otherwise."""
    if not any(is_control_key(f.key) for f in free):
        return list(records)
    return [
        replace(r, measurement=replace(r.measurement, control=r.measurement.control is not False))
        for r in records
    ]


def _add_reasons(
    assessment: ModelAssessment,
    problem: FitProblem,
    curves: Sequence[dict[str, np.ndarray]],
    held: dict[str, Any] | None,
    unsure: bool,
) -> None:
    """Add what the held-out records, other impacts and unknown keys say of the model."""
    if assessment.verdict is ModelVerdict.DOES_NOT_FIT:
        assessment.reasons += [
            sentence
            for c, curve in zip(problem.channels, curves, strict=True)
            for sentence in note_other_impact(c, curve)
        ]
    ratio = 0.0 if held is None else held["residual_over_noise"]
    if assessment.verdict is ModelVerdict.FITS and ratio > _HELD_OUT:
        assessment.verdict = ModelVerdict.DOES_NOT_FIT
        assessment.reasons.append(f"The held-out records are {ratio:.3g} times the noise away.")
    if assessment.verdict is ModelVerdict.FITS and unsure:
        assessment.reasons.append("The model fits, but not every key is identifiable.")
