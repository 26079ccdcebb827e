"""Records that are held out of a fit and compared with its result."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hertzloop.identification.fit.errors import FitError
from hertzloop.identification.fit.free_keys import FreeKey
from hertzloop.identification.fit.hit_speeds import hit_speed_keys
from hertzloop.identification.fit.minimise import minimise
from hertzloop.identification.fit.prepare import prepare_problem
from hertzloop.identification.fit.residuals import describe_nuisances, independent_samples
from hertzloop.identification.fit.solution import solve_with_model_errors
from hertzloop.identification.fit.whole_steps import search_whole_steps
from hertzloop.identification.hits.split import split_hits
from hertzloop.identification.records.record import Record
from hertzloop.scene.setup import Setup


def split_hold_out(
    records: Sequence[Record], hold_out: Sequence[Record | int] | None, setup: Setup
) -> tuple[list[Record], list[Record]]:
    """The records to fit, and those to compare: hits by number, and other records. Raises
    FitError."""
    hits = sorted({one.hit for one in records if one.hit})
    if hold_out is None:
        hold_out = hits[-1:] if len(hits) > 1 else []
    numbers = {one for one in hold_out if isinstance(one, int)}
    if numbers - set(hits) or (numbers and numbers == set(hits)):
        raise FitError(
            f"--hold-out {min(numbers)}: cannot be held out. The hits are "
            f"{', '.join(map(str, hits)) or 'not several'}; at least one is fitted."
        )
    others = split_hits([one for one in hold_out if isinstance(one, Record)], setup)
    fitted = [one for one in records if one.hit not in numbers]
    return fitted, [one for one in records if one.hit in numbers] + others


def compare_hold_out(
    fitted: Setup, records: Sequence[Record], free: Sequence[FreeKey], exact: bool
) -> dict[str, Any]:
    """Compare records with the fitted scene; only their nuisances, and the speed of every hit, are
    found anew."""
    problem = prepare_problem(fitted, records, hit_speed_keys(fitted, records, free, 1))
    if problem.looped:
        problem = search_whole_steps(problem)
    until_s = problem.windows_s()[-1]
    iterate = minimise(problem, problem.start_vector(), until_s, early=False)
    found = solve_with_model_errors(problem, iterate, until_s, exact)
    problem = found.problem
    plain = problem.evaluate(found.iterate.x, until_s, early=False, jacobian=False, exact=True)
    rows = np.concatenate([plain.residual[s] for s in plain.channel_rows])
    samples = sum(independent_samples(problem, plain, i, until_s) for i in range(len(records)))
    ratio = math.sqrt(float(rows @ rows) / max(samples - len(plain.x), 1.0))
    nuisances = describe_nuisances(problem, plain, until_s)
    return {
        "records": [r.name for r in records],
        "residual_over_noise": ratio,
        "gain": [n.gain for n in nuisances],
        "in_pulse_percent": [n.off_percent[0] for n in nuisances],
        "after_pulse_percent": [n.off_percent[1] for n in nuisances],
        "largest_percent": [n.off_percent[2] for n in nuisances],
    }
