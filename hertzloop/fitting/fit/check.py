"""Report what records can tell about keys without a fit, also of a supposed record."""

import math
import re
import time
from collections.abc import Sequence

import numpy as np

from hertzloop.fitting.errors import FitError
from hertzloop.fitting.fit.assessment import ModelAssessment, common_fields, impact_speeds
from hertzloop.fitting.fit.channel import LASTING_S
from hertzloop.fitting.fit.free_keys import FreeKey, refuse_duplicates
from hertzloop.fitting.fit.impact_simulator import ImpactSimulator, LoopSimulator
from hertzloop.fitting.fit.intervals import (
    add_discrete_estimate,
    estimate_from_covariance,
    key_uncertainty,
)
from hertzloop.fitting.fit.problem_preparation import (
    check_sample_count,
    prepare_problem,
    refuse_incomparable,
    refuse_unknown_loop,
    unique_names,
)
from hertzloop.fitting.fit.results import FitResult, ModelVerdict
from hertzloop.fitting.fit.simulated_impact import MeasuringChain, observe
from hertzloop.fitting.fit.step_scan import expected_profile
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.quantities import QUANTITIES
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup

_MOST_EXPECTED = 10_000_000  # samples of an expected record
_NUMBER = r"((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
_EXPECTED = re.compile(rf"([a-z_]+):{_NUMBER}us:{_NUMBER}%(?::{_NUMBER}MHz)?")


def expected_record(
    setup: Setup, text: str, name: str = "expected record", control: bool | None = None
) -> Record:
    """Return a made-up record of the scene as it is, for a check before an experiment.

    Args:
        setup: the scene.
        text: `QUANTITY:DURATIONus:NOISE%[:RATEMHz]`, as `contact_force:70us:0.3%:2MHz`; the noise
            is a share of the peak.
        name: of the record.
        control: whether the law is on; by default for the force of the actuator alone.

    Raises:
        FitError: the text is not of this form.
    """
    match = _EXPECTED.fullmatch(text.strip())
    numbers = [float(number) for number in match.groups("2")[1:]] if match else []
    if match is None or match[1] not in QUANTITIES or not all(0.0 < x < math.inf for x in numbers):
        raise FitError(
            f"--expect {text}: is not QUANTITY:DURATIONus:NOISE%[:RATEMHz] with positive numbers, "
            f"such as contact_force:70us:0.3%:2MHz. Known quantities: {', '.join(QUANTITIES)}."
        )
    quantity, (duration_us, percent, rate_mhz) = match[1], numbers
    duration_s, step_s = 1e-6 * duration_us, 1e-6 / rate_mhz
    quiet_s = max(250 * step_s, 0.2e-3)
    samples = (duration_s + quiet_s) / step_s
    if duration_s > LASTING_S or samples > _MOST_EXPECTED:
        raise FitError(
            f"--expect {text}: is a record of {1e3 * duration_s:.3g} ms with {samples:.3g} "
            f"samples. Suppose at most {1e3 * LASTING_S:g} ms and {_MOST_EXPECTED:g} samples."
        )
    under = quantity == "actuator_force" if control is None else control
    table = Measurement(quantity=quantity, control=under)
    simulator: ImpactSimulator
    if under:
        refuse_unknown_loop(setup)
        plain = Record(name, np.arange(8.0), np.ones(8), quantity, measurement=table)
        refuse_incomparable(plain, setup)
        simulator = LoopSimulator(setup, duration_s, 1e-4)
    else:
        simulator = ImpactSimulator(setup, duration_s, 1e-4)
    time_s = np.arange(-quiet_s, duration_s, step_s)
    clean = observe(simulator.run({}, duration_s), quantity, MeasuringChain(), False).value(time_s)
    noise = 0.01 * percent * float(np.max(np.abs(clean)))
    # The noise has a known size and no influence on the answer; its seed makes it repeatable.
    noisy = clean + noise * np.random.default_rng(1).standard_normal(len(clean))
    return Record(name, time_s, noisy, quantity, measurement=table)


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
