"""Decide whether the class of models fits the records.

The residual of the exact model is tested: the discrepancy that widens the intervals (`solution.py`)
excuses nothing here.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hertzloop.fitting.fit.assessment.residual_tests import ResidualTests
from hertzloop.fitting.fit.assessment.residuals import residual_curves
from hertzloop.fitting.fit.channels.channel import ENOUGH_QUIET
from hertzloop.fitting.fit.problem.iterate import Iterate
from hertzloop.fitting.fit.problem.priors import prior_pulls
from hertzloop.fitting.fit.problem.problem import FitProblem
from hertzloop.fitting.fit.verdicts import ModelVerdict

_F_P, _WHITE_P, _PULL = 0.01, 0.001, 3.0
_HELD_OUT = 2.0  # residual of held-out records over their noise, above which a model does not fit


@dataclass
class ModelAssessment:
    """Whether the model class fits, and why.

    `residual_over_noise`: of all channels. `f_p`: least probability of an F test of the residual
    against the noise before the impact, corrected for the number of windows; None without enough
    such samples. `white_p`: least probability of the Ljung-Box test of ten lags, corrected for the
    number of records. `pulls`: of priors, standard deviations. `reasons`: sentences.
    """

    verdict: ModelVerdict
    residual_over_noise: float
    f_p: float | None = None
    white_p: float | None = None
    pulls: dict[str, float] = field(default_factory=dict)
    at_bound: list[str] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """Statistics for JSON."""
        return {
            "f_test_p": self.f_p,
            "ljung_box_p": self.white_p,
            "prior_pulls_sigma": self.pulls,
            "at_bound": self.at_bound,
        }


def assess_model(
    problem: FitProblem,
    iterate: Iterate,
    one_sided: set[str],
    unsure: set[str],
    held_out_over_noise: float,
) -> ModelAssessment:
    """Judge the class of models by the residual of a fit.

    Args:
        problem: the fit.
        iterate: its solution, with the model taken as exact.
        one_sided: keys that have an interval with one open end, and may be at a bound.
        unsure: keys that are not identifiable, and may be at a bound.
        held_out_over_noise: residual of held-out records over their noise; zero without any.
    """
    tests = ResidualTests(problem, iterate)
    f_p, white_p = tests.f_p, tests.white_p
    pulls = prior_pulls(problem, iterate.x)
    at_bound = {
        f.key: side
        for f, x in zip(problem.varied_keys, iterate.x, strict=False)
        if (side := f.at_bound(float(x)))
    }
    coarse = f_p is not None and f_p < _F_P <= tests.beyond * tests.count
    reasons: list[str] = []
    if f_p is not None and f_p < _F_P and not coarse:
        reasons.append(
            f"{tests.shown}; with the right class of models that has a probability of {f_p:.1g}."
        )
    if white_p < _WHITE_P:
        reasons.append(
            f"The residual has a pattern: white noise would show it with a probability of "
            f"{white_p:.1g}."
        )
    for name, pull in pulls.items():
        if abs(pull) > _PULL:
            reasons.append(f"The prior of {name} is pulled by {pull:z.1f} standard deviations.")
    for key, side in at_bound.items():
        if key not in one_sided | unsure:
            reasons.append(
                f"{key} is at a bound of its range, the {side} one. Widen the range with --free "
                f"{key}=LOW:HIGH, or check the other values of the scene."
            )
    if reasons:
        verdict = ModelVerdict.DOES_NOT_FIT
        reasons += _other_impacts(problem, iterate)
    elif coarse:
        verdict = ModelVerdict.CANNOT_TELL
        reasons.append(f"{tests.shown}. {_coarse_simulation(problem)}")
    elif f_p is None or not tests.quiet_known:
        verdict = ModelVerdict.CANNOT_TELL
        reasons.append(
            f"Fewer than {ENOUGH_QUIET} samples before the impact: the noise is not known well "
            "enough to test the residual against it."
        )
    elif held_out_over_noise > _HELD_OUT:
        verdict = ModelVerdict.DOES_NOT_FIT
        reasons.append(f"The held-out records are {held_out_over_noise:.3g} times the noise away.")
    else:
        verdict = ModelVerdict.FITS
        if unsure:
            reasons.append("The model fits, but not every key is identifiable.")
    ratio = tests.residual_over_noise
    return ModelAssessment(verdict, ratio, f_p, white_p, pulls, list(at_bound), reasons)


def _other_impacts(problem: FitProblem, iterate: Iterate) -> list[str]:
    """Return sentences on impacts in records of the force that the simulation does not have."""
    found = []
    for c, curve in zip(problem.channels, residual_curves(problem, iterate), strict=True):
        if c.record.quantity != "contact_force":
            continue
        high = 0.1 * c.peak
        measured = np.where(curve["used"], curve["measured"] - c.baseline, 0.0) > high
        simulated = curve["simulated"] - np.min(curve["simulated"]) > 0.01 * c.peak
        late = curve["time_s"] > curve["time_s"][np.argmax(curve["simulated"])]
        alone = measured & ~simulated & late
        places = np.flatnonzero(alone[:-1] & alone[1:])
        if len(places):
            found.append(
                f"{c.record.name}: an impact {1e6 * curve['time_s'][places[0]]:.3g} us after the "
                "first is not in the simulation. If it is another drop, cut the record "
                "before it."
            )
    return found


def _coarse_simulation(problem: FitProblem) -> str:
    """Return sentences on the error of the simulation, and what to do."""
    worst = max(problem.channels, key=lambda c: c.simulation_error)
    return (
        "The error of the simulation can explain that: during contact it is about "
        f"{worst.simulation_error:.2g} times the noise of {worst.record.name}. A finer simulation "
        f"of {1e3 * worst.duration_s:.3g} ms would take too long. Cut the record sooner after the "
        "impact."
    )
