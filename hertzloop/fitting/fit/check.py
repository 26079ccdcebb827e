"""Report what records can tell about keys, without a fit."""

import math
import time
from collections.abc import Sequence

from hertzloop.fitting.fit.assessment.assessment import ModelAssessment
from hertzloop.fitting.fit.assessment.residuals import impact_speeds
from hertzloop.fitting.fit.assessment.summary import (
    check_sample_count,
    common_fields,
    unique_names,
)
from hertzloop.fitting.fit.keys.free_keys import FreeKey, refuse_duplicates
from hertzloop.fitting.fit.problem.problem_preparation import prepare_problem
from hertzloop.fitting.fit.results import FitResult
from hertzloop.fitting.fit.solver.discrete_key import expected_profile
from hertzloop.fitting.fit.uncertainty.intervals import (
    add_discrete_estimate,
    estimate_from_covariance,
)
from hertzloop.fitting.fit.uncertainty.key_uncertainty import key_uncertainty
from hertzloop.fitting.fit.verdicts import ModelVerdict
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup


def check(setup: Setup, records: Sequence[Record], free: Sequence[FreeKey]) -> FitResult:
    """Report what records can tell about keys, at the starting values and without a fit.

    Raises:
        RecordError, SceneError, FitError
    """
    began = time.perf_counter()
    records = unique_names(records)
    refuse_duplicates(free)
    problem = prepare_problem(setup, records, free)
    discrete, profile = problem.discrete_key, None
    if discrete is not None:
        problem = problem.hold({discrete.key: discrete.start})
    iterate = problem.evaluate(problem.start_vector(), problem.windows_s()[-1])
    if discrete is not None:
        profile = expected_profile(problem, iterate)
    check_sample_count(iterate)
    known = key_uncertainty(problem, iterate)
    estimates = [
        estimate_from_covariance(f, f.start, float(sd), float(alone), None)
        for f, sd, alone in zip(problem.varied_keys, known.sd, known.alone, strict=True)
    ]
    estimates = add_discrete_estimate(problem, estimates, known, profile)
    reasons = ["This is a check before a fit: nothing was fitted."]
    assessment = ModelAssessment(ModelVerdict.CANNOT_TELL, math.nan, reasons=reasons)
    return FitResult(
        **common_fields(problem, iterate, known, assessment),
        estimates=estimates,
        wall_s=time.perf_counter() - began,
        speeds_m_s=impact_speeds(problem, {}),
        records=list(records),
        checked_only=True,
    )
