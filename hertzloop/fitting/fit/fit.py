"""Fit scene keys to records, and compare records that are held out."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hertzloop.fitting.errors import FitError
from hertzloop.fitting.fit.assessment import (
    assess_model,
    common_fields,
    describe_nuisances,
    impact_speeds,
    independent_samples,
    residual_curves,
)
from hertzloop.fitting.fit.channel import exclude_contact
from hertzloop.fitting.fit.free_keys import FreeKey, is_chain_key, is_control_key, refuse_duplicates
from hertzloop.fitting.fit.intervals import add_discrete_estimate, estimate_keys, key_uncertainty
from hertzloop.fitting.fit.minimise import best_start, minimise, search_lower_minimum
from hertzloop.fitting.fit.problem import FitProblem, Iterate
from hertzloop.fitting.fit.problem_preparation import (
    check_sample_count,
    prepare_problem,
    rebuild_simulators,
    unique_names,
)
from hertzloop.fitting.fit.results import FitResult
from hertzloop.fitting.fit.solution import solve
from hertzloop.fitting.fit.step_scan import scan_steps
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup

_OF_RECORD = ("gain", "in_pulse_percent", "after_pulse_percent", "largest_percent")
_MOVED = 0.01  # change of a key's logarithm for which the modes of the plate are chosen anew
_LAST_STAGES = 2  # minimisations after the windows, for the estimate of the time left


def leave_out_held(records: Sequence[Record], held: Sequence[Record]) -> list[Record]:
    """Return the records that are not held out as well. Raises FitError if none is left."""
    found = [one for one in records if not any(one.repeats(other) for other in held)]
    if not found:
        raise FitError(
            f"--hold-out {held[0].name}: leaves no record to fit. Give another RECORD, or hold "
            "out fewer."
        )
    return found


def compare_hold_out(fitted: Setup, records: Sequence[Record], exact: bool) -> dict[str, Any]:
    """Compare records with the fitted scene; only their nuisances are found anew."""
    problem = prepare_problem(fitted, records, [])
    x = scan_steps(problem)[1] if problem.looped else problem.start_vector()
    iterate = minimise(problem, x, problem.windows_s()[-1])
    found = solve(problem, iterate.x, [], exact)
    problem, plain = found.problem, found.exact_iterate()
    rows = np.concatenate([plain.residual[one.rows] for one in plain.channels])
    samples = sum(map(independent_samples, problem.channels, plain.channels))
    ratio = math.sqrt(float(rows @ rows) / max(samples - len(plain.x), 1.0))
    nuisances = describe_nuisances(problem, plain)
    return {
        "records": [r.name for r in records],
        "residual_over_noise": ratio,
        **{key: [getattr(n, key) for n in nuisances] for key in _OF_RECORD},
    }


def fit(
    setup: Setup,
    records: Sequence[Record],
    free: Sequence[FreeKey],
    hold_out: Sequence[Record] = (),
    on_progress: Callable[[int, int], None] = lambda done, expected: None,
    exact: bool = False,
) -> FitResult:
    """Fit scene keys to records.

    Args:
        setup: the scene to start from, in which everything else is known.
        records: at least one; all share the keys.
        free: the keys to find.
        hold_out: records that are only compared with the result, also if they are among `records`.
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
    records = unique_names(leave_out_held(records, hold_out))
    problem = prepare_problem(setup, records, free)
    problem.counter.on_progress = on_progress
    windows = _fit_growing_windows(problem)
    problem = _rebuild_if_moved(setup, windows)
    for c, simulator in zip(problem.channels, problem.simulators, strict=True):
        exclude_contact(c, simulator.contact_s)  # only now: the early windows hold little else
    problem.counter.expect(1, len(problem.varied_keys))
    solution = solve(problem, windows.iterate.x, windows.shorter, exact)
    problem, iterate = solution.problem, solution.iterate
    check_sample_count(iterate)
    known = key_uncertainty(problem, iterate, solution.shifts)
    estimates = estimate_keys(problem, iterate, known)
    estimates = add_discrete_estimate(problem, estimates, known, solution.profile)
    plain = solution.exact_iterate()
    values = problem.key_values(iterate.x)
    fitted = _fitted_setup(setup, values)
    held, held_over_noise = None, 0.0
    if hold_out:
        held = compare_hold_out(fitted, _under_same_law(hold_out, free), exact)
        held_over_noise = held["residual_over_noise"]
    assessment = assess_model(problem, plain, estimates, held_over_noise)
    return FitResult(
        **common_fields(problem, plain, known, assessment),
        estimates=estimates,
        hold_out=held,
        setup=fitted,
        curves=residual_curves(problem, plain),
        wall_s=time.perf_counter() - began,
        speeds_m_s=impact_speeds(problem, values),
        records=list(records),
    )


@dataclass
class _WindowsFit:
    """Solutions of the whole records and of shorter windows, the shortest first."""

    problem: FitProblem
    iterate: Iterate
    shorter: list[Iterate]


def _fit_growing_windows(problem: FitProblem) -> _WindowsFit:
    """Fit the keys to growing parts of the records, each from the solution of the one before."""
    counter, keys = problem.counter, len(problem.varied_keys)
    if problem.looped:
        problem, x = scan_steps(problem)
    else:
        x = problem.start_vector()
    x = best_start(problem, x)
    ends, iterates = problem.windows_s(), []
    for i, end in enumerate(ends):
        counter.expect(len(ends) - i + _LAST_STAGES, keys)
        early = end < ends[-1]
        iterates.append(minimise(problem, x, end, early, steps=15, tolerance=1e-3))
        x = iterates[-1].x
    *shorter, iterate = iterates
    counter.expect(_LAST_STAGES, keys)
    if not problem.looped:
        iterate = search_lower_minimum(problem, iterate, shorter)
    return _WindowsFit(problem, iterate, shorter)


def _rebuild_if_moved(setup: Setup, windows: _WindowsFit) -> FitProblem:
    """Return the problem, with new simulators if a key has moved."""
    problem, x = windows.problem, windows.iterate.x
    moves = [abs(math.log(f.start) - v) for f, v in zip(problem.varied_keys, x, strict=False)]
    if max(moves, default=0.0) <= _MOVED:
        return problem
    return rebuild_simulators(setup, problem, problem.key_values(x))


def _fitted_setup(setup: Setup, values: dict[str, float]) -> Setup:
    """Return the setup with the fitted values."""
    for of_sensor in (False, True):
        setup = setup.vary({k: v for k, v in values.items() if is_chain_key(k) is of_sensor})
    return setup


def _under_same_law(records: Sequence[Record], free: Sequence[FreeKey]) -> list[Record]:
    """The records, which are under the law if a key of it is free and they do not say otherwise."""
    if not any(is_control_key(f.key) for f in free):
        return list(records)
    return [
        replace(r, measurement=replace(r.measurement, control=r.measurement.control is not False))
        for r in records
    ]
