"""Report what records can tell about keys, without a fit."""

import math
import time
from collections.abc import Sequence
from dataclasses import replace

from hertzloop.identification.fit.assessment import ModelAssessment
from hertzloop.identification.fit.free_keys import FreeKey, refuse_duplicates
from hertzloop.identification.fit.hit_speeds import add_hit_speeds
from hertzloop.identification.fit.intervals import add_whole_step_estimate, estimate_from_covariance
from hertzloop.identification.fit.prepare import prepare_problem
from hertzloop.identification.fit.residuals import impact_speeds
from hertzloop.identification.fit.results import FitResult
from hertzloop.identification.fit.summary import (
    check_sample_count,
    collect_notes,
    common_fields,
    unique_names,
)
from hertzloop.identification.fit.uncertainty import key_uncertainty
from hertzloop.identification.fit.verdicts import ModelVerdict
from hertzloop.identification.fit.whole_steps import expected_profile
from hertzloop.identification.hits.split import split_hits
from hertzloop.identification.records.record import Record
from hertzloop.scene.setup import Setup


def check(setup: Setup, records: Sequence[Record], free: Sequence[FreeKey]) -> FitResult:
    """Report what records can tell about keys, at the starting values and without a fit.

    Raises:
        RecordError, SceneError, FitError
    """
    began = time.perf_counter()
    records = split_hits(unique_names(records), setup)
    refuse_duplicates(free)
    free = add_hit_speeds(setup, records, free)
    problem = prepare_problem(setup, records, free)
    until_s = problem.windows_s()[-1]
    stepped, profile = problem.whole_step_key, None
    if stepped is not None:
        problem = replace(problem, fixed={stepped.key: stepped.start})
    iterate = problem.evaluate(problem.start_vector(), until_s, early=False)
    if stepped is not None:
        profile = expected_profile(problem, iterate, until_s)
    check_sample_count(iterate)
    known = key_uncertainty(problem, iterate)
    estimates = [
        estimate_from_covariance(f, f.start, float(sd), float(alone), None)
        for f, sd, alone in zip(problem.varied_keys, known.sd, known.alone, strict=True)
    ]
    estimates = add_whole_step_estimate(problem, estimates, known, profile)
    fits = ModelAssessment(ModelVerdict.CANNOT_TELL, math.nan)
    fits.reasons.append("This is a check before a fit: nothing was fitted.")
    return FitResult(
        **common_fields(problem, iterate, iterate, until_s, known, fits),
        estimates=estimates,
        evaluations=problem.counter.done,
        wall_s=time.perf_counter() - began,
        notes=collect_notes(problem, setup),
        speeds_m_s=impact_speeds(problem, {}),
        records=list(records),
        checked_only=True,
    )
