"""Records that are held out of a fit and compared with its result."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hertzloop.fitting.fit.assessment.residuals import (
    describe_nuisances,
    independent_samples,
)
from hertzloop.fitting.fit.errors import FitError
from hertzloop.fitting.fit.problem.problem_preparation import prepare_problem
from hertzloop.fitting.fit.solver.discrete_key import search_discrete_key
from hertzloop.fitting.fit.solver.minimise import minimise
from hertzloop.fitting.fit.solver.solution import solve
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup

_OF_RECORD = ("gain", "in_pulse_percent", "after_pulse_percent", "largest_percent")


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
    if problem.looped:
        problem = search_discrete_key(problem)
    until_s = problem.windows_s()[-1]
    iterate = minimise(problem, problem.start_vector(), until_s)
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
