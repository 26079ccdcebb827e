"""Solve a fit without outliers, with the errors of the model and of unknown noise.

A fit meets a wrong model by two mechanisms. Here the error of the model is estimated, as
`discrepancy.py` describes it, and widens the intervals. `assessment.py` tests the residual of the
exact model, without that error, and gives the verdict on the model.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hertzloop.identification.fit.discrepancy import build_discrepancy
from hertzloop.identification.fit.discrepancy_estimate import (
    RecordLikelihood,
    estimate_discrepancies,
)
from hertzloop.identification.fit.iterate import Iterate
from hertzloop.identification.fit.minimise import minimise
from hertzloop.identification.fit.outliers import reject_outliers
from hertzloop.identification.fit.phases import minimise_over_phases
from hertzloop.identification.fit.problem import FitProblem
from hertzloop.identification.fit.whole_steps import StepProfile, profile_whole_steps

_ROUNDS = 4  # of outliers
_ESTIMATES, _SETTLED = 3, 0.2  # of the model's error: most rounds, change that needs another one


@dataclass
class Solution:
    """A solution, the profile of a key in whole steps, and minus twice the logarithm of its
    likelihood, of one with estimated errors."""

    problem: FitProblem
    iterate: Iterate
    profile: StepProfile | None
    cost: float = math.inf

    @property
    def has_model_error(self) -> bool:
        """Whether the model has an error in a record."""
        return self.problem.has_model_error


def solve_with_model_errors(
    problem: FitProblem, iterate: Iterate, until_s: float, exact: bool
) -> Solution:
    """Return the solution near an iterate, without outliers, with estimated errors and noises.

    Args:
        problem: the fit; its channels stay as they are.
        iterate: where to start.
        until_s: end of the window after the touch, s.
        exact: whether the model is taken as exact; unknown noises are estimated all the same.
    """
    found = _solve_without_outliers(problem, iterate, until_s)
    for _ in range(_ESTIMATES):
        cost, changed = _estimate_errors(found.problem, found.iterate, until_s, exact)
        if changed:
            found = _solve_without_outliers(found.problem, found.iterate, until_s)
        found.cost = cost
        if not changed:
            break
    return found


def _solve_without_outliers(problem: FitProblem, iterate: Iterate, until_s: float) -> Solution:
    """Return the solution near an iterate without outliers, with channels of its own."""
    channels = [replace(c) for c in problem.channels]
    problem, profile = replace(problem, channels=channels), None
    for rounds in range(_ROUNDS + 1):
        if problem.whole_step_key is not None:
            problem, iterate, profile = profile_whole_steps(problem, iterate, until_s)
        elif problem.looped:
            iterate = minimise_over_phases(problem, iterate.x, until_s)
        enough: dict[str, Any] = {"steps": 12, "tolerance": 1e-4} if problem.has_model_error else {}
        iterate = minimise(problem, iterate.x, until_s, early=False, **enough)
        if rounds == _ROUNDS or not reject_outliers(problem, iterate, until_s):
            break
    return Solution(problem, iterate, profile)


def _estimate_errors(
    problem: FitProblem, iterate: Iterate, until_s: float, exact: bool
) -> tuple[float, bool]:
    """Estimate errors of the model and unknown noises at a solution, and give them to the channels.

    Returns:
        Minus twice the logarithm of the likelihood, and whether anything has changed.
    """
    plain = problem.evaluate(iterate.x, until_s, early=False, exact=True)
    whole = np.column_stack([plain.jacobian, plain.residual])
    errors, rows = [], []
    for index, (c, model) in enumerate(zip(problem.channels, problem.models, strict=True)):
        value, _, tau, _ = problem.predict(iterate.x, index, until_s)
        gain, counted = problem.nuisances(iterate.x, index)[2], c.counted(tau <= until_s)
        signal = np.full(len(tau), c.peak) if c.is_gap else gain * value
        chain = problem.chains[index]
        wall_hz = chain.low_pass_hz if chain.before_s else None
        error = (
            None
            if exact
            else build_discrepancy(tau, signal, c.whitening(), model.contact_s, wall_hz)
        )
        errors.append(error)
        rows.append(
            RecordLikelihood(
                whole[plain.channel_rows[index]],
                float(np.sum(c.independent(counted))),
                error and error.on_samples(counted),
                c.discrepancy is not None,
                c.least_noise / c.noise if c.noise_unknown else None,
            )
        )
    cost, found, kappa = estimate_discrepancies(rows, whole[plain.prior_rows])
    changed = False
    for c, error, r, (shares, factor) in zip(problem.channels, errors, rows, found, strict=True):
        before = np.array(c.discrepancy.shares if c.discrepancy else (0.0, 0.0))
        apart = np.abs(before - shares) > _SETTLED * np.maximum(before, shares)
        changed |= bool(np.any(apart)) or abs(factor - 1.0) > 0.1 * _SETTLED
        cost += 2.0 * r.count * math.log(c.noise)
        c.noise *= factor
        c.discrepancy = None
        if error is not None and any(shares):
            basis = error.basis / factor
            c.discrepancy = replace(error, shares=shares, kappa=kappa, basis=basis, _on={})
    return cost, changed
