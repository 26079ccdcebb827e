"""Solve a fit without outliers, with the discrepancies of the model and unknown noises.

A fit meets an inexact model twice. This file decides how far it widens the intervals: the solution
has a discrepancy where the noise does not explain a residual. `assessment.py` decides whether the
model fits: it tests the residual of the exact model, without the discrepancy.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hertzloop.fitting.fit.discrepancy import (
    RecordLikelihood,
    build_discrepancy,
    estimate_discrepancies,
)
from hertzloop.fitting.fit.minimise import minimise
from hertzloop.fitting.fit.noise import robust_deviation
from hertzloop.fitting.fit.problem import FitProblem, Iterate
from hertzloop.fitting.fit.step_scan import StepProfile, fit_phases, profile_steps

OUTLIER = 4.0  # robust deviations
_MOST_OUTLIERS = 0.06
_FEW = 60  # samples of a pulse, none of which is taken out
_LONGEST_RUN = 2  # outliers in a row; longer ones are a misfit
_ROUNDS = 4  # of outliers
_ESTIMATES, _SETTLED = 3, 0.2  # of discrepancies: most rounds, change that needs another one


def reject_outliers(problem: FitProblem, iterate: Iterate) -> bool:
    """Take isolated samples out that are more than four robust deviations away.

    Returns:
        Whether there were any. A run of more than two is a misfit and stays, as do all if they are
        more than 6 % of a record.
    """
    found = False
    channels = zip(problem.channels, iterate.channels, problem.simulators, strict=True)
    for c, (predicted, _, _), simulator in channels:
        tau, residual = predicted.tau, np.where(c.kept, predicted.reading - c.value, 0.0)
        used = c.kept & (tau <= iterate.until_s)
        if np.count_nonzero(used) < 20:
            continue
        sd = robust_deviation(residual[used])
        sd = max(sd, c.noise if c.noise_from == "quiet" else 0.0, 0.5 * c.step)
        far = used & (np.abs(residual) > OUTLIER * sd)
        contact = (tau > -0.5 * simulator.contact_s) & (tau < 1.5 * simulator.contact_s)
        if np.count_nonzero(contact) < _FEW:  # a misfit of the pulse is as short as an outlier
            far &= ~contact
        runs = np.split(np.flatnonzero(far), np.flatnonzero(np.diff(np.flatnonzero(far)) > 1) + 1)
        single = [i for run in runs if 0 < len(run) <= _LONGEST_RUN for i in run]
        if len(single) > _MOST_OUTLIERS * np.count_nonzero(used):
            continue
        # Of Gauss's noise 6 samples of 100 000 are as far out; these cost nothing.
        if single:
            c.kept = c.kept.copy()
            c.kept[np.array(single)] = False
            c.rejected += len(single)
            found = True
    return found


@dataclass
class Solution:
    """A solution of a fit.

    Attributes:
        problem: with channels of its own.
        iterate: the best one.
        profile: of a discrete key; None without one.
        cost: minus twice the logarithm of the likelihood.
        shifts: how far the keys are from the solutions of shorter windows, beyond noise, (keys,)
            for each window.
    """

    problem: FitProblem
    iterate: Iterate
    profile: StepProfile | None
    cost: float = math.inf
    shifts: Sequence[np.ndarray] = ()

    def exact_iterate(self) -> Iterate:
        """Return the residuals with the model taken as exact, without derivatives."""
        x, until_s = self.iterate.x, self.iterate.until_s
        return self.problem.evaluate(x, until_s, jacobian=False, exact=True)


def solve(problem: FitProblem, x: np.ndarray, shorter: Sequence[Iterate], exact: bool) -> Solution:
    """Return the solution of the whole records.

    `x` was found with an exact model, so errors late in the record may have pulled the keys away.
    Where the solution has a discrepancy, it is also sought from the solution of the first window.

    Args:
        problem: the fit; its channels stay as they are.
        x: solution of the whole records with an exact model.
        shorter: solutions of shorter windows.
        exact: whether the model is taken as exact; unknown noises are estimated all the same.
    """
    found = _solve_from(problem, x, exact)
    if not found.problem.has_discrepancy:
        return found
    if shorter and not problem.looped:
        other = _solve_from(problem, shorter[0].x, exact)
        found = min(found, other, key=lambda one: one.cost)
    found.shifts = _shifts_beyond_noise(problem, shorter, found.iterate)
    return found


def _solve_from(problem: FitProblem, x: np.ndarray, exact: bool) -> Solution:
    """Return the solution near parameters."""
    found = _solve_without_outliers(problem, x)
    for _ in range(_ESTIMATES):
        cost, changed = _estimate_discrepancies(found.problem, found.iterate, exact)
        if changed:
            found = _solve_without_outliers(found.problem, found.iterate.x)
        found.cost = cost
        if not changed:
            break
    return found


def _solve_without_outliers(problem: FitProblem, x: np.ndarray) -> Solution:
    """Return the solution near parameters without outliers, with channels of its own."""
    channels = [replace(c) for c in problem.channels]
    problem, profile = replace(problem, channels=channels), None
    until_s = problem.windows_s()[-1]
    for rounds in range(_ROUNDS + 1):
        if problem.discrete_key is not None:
            problem, profile = profile_steps(problem, x, until_s)
            x = profile.iterates[profile.best].x
        elif problem.looped:
            x = fit_phases(problem, x, until_s).x
        enough: dict[str, Any] = {"steps": 12, "tolerance": 1e-4} if problem.has_discrepancy else {}
        iterate = minimise(problem, x, until_s, **enough)
        x = iterate.x
        if rounds == _ROUNDS or not reject_outliers(problem, iterate):
            break
    return Solution(problem, iterate, profile)


def _estimate_discrepancies(
    problem: FitProblem, iterate: Iterate, exact: bool
) -> tuple[float, bool]:
    """Estimate discrepancies and unknown noises at a solution, and give them to the channels.

    Returns:
        Minus twice the logarithm of the likelihood, and whether anything has changed.
    """
    plain = problem.evaluate(iterate.x, iterate.until_s, exact=True)
    whole = np.column_stack([plain.jacobian, plain.residual])
    discrepancies, records = [], []
    for index, (c, (predicted, counted, rows)) in enumerate(
        zip(problem.channels, plain.channels, strict=True)
    ):
        tau, gain = predicted.tau, problem.nuisances(iterate.x, index)[2]
        signal = np.full(len(tau), c.peak) if c.is_gap else gain * predicted.value
        chain, contact_s = problem.chains[index], problem.simulators[index].contact_s
        wall_hz = chain.low_pass_hz if chain.before_s else None
        discrepancy = (
            None if exact else build_discrepancy(tau, signal, c.whitening(), contact_s, wall_hz)
        )
        discrepancies.append(discrepancy)
        records.append(
            RecordLikelihood(
                whole[rows],
                float(np.sum(c.independent(counted))),
                discrepancy and discrepancy.on_samples(counted),
                c.discrepancy is not None,
                c.least_noise / c.noise if c.noise_estimated else None,
            )
        )
    cost, found, kappa = estimate_discrepancies(records, whole[plain.prior_rows])
    changed = False
    for c, discrepancy, record, (shares, factor) in zip(
        problem.channels, discrepancies, records, found, strict=True
    ):
        before = np.array(c.discrepancy.shares if c.discrepancy else (0.0, 0.0))
        apart = np.abs(before - shares) > _SETTLED * np.maximum(before, shares)
        changed |= bool(np.any(apart)) or abs(factor - 1.0) > 0.1 * _SETTLED
        # An outlier costs what the farthest sample that counts does: else solutions that reject
        # more could not be compared.
        cost += 2.0 * (record.count + c.rejected) * math.log(c.noise) + OUTLIER**2 * c.rejected
        c.noise *= factor
        c.discrepancy = None
        if discrepancy is not None and any(shares):
            basis = discrepancy.basis / factor
            c.discrepancy = replace(discrepancy, shares=shares, kappa=kappa, basis=basis, _on={})
    return cost, changed


def _shifts_beyond_noise(
    problem: FitProblem, shorter: Sequence[Iterate], iterate: Iterate
) -> list[np.ndarray]:
    """Return how much farther the keys of a solution are from those of shorter windows than noise
    explains, (keys,) for each window."""
    n, found = len(problem.varied_keys), []
    for one in shorter:
        apart = (one.x - iterate.x)[:n]
        again = problem.evaluate(one.x, one.until_s, early=True)
        variance = np.diag(again.covariance())[:n]
        found.append(np.sign(apart) * np.sqrt(np.maximum(apart**2 - variance, 0.0)))
    return found
