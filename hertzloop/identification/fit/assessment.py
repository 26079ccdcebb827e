"""Whether the class of models fits the records, by the residual of a fit."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy

from hertzloop.identification.fit.channel import ENOUGH_QUIET, Channel
from hertzloop.identification.fit.iterate import Iterate
from hertzloop.identification.fit.noise import ljung_box
from hertzloop.identification.fit.problem import FitProblem
from hertzloop.identification.fit.verdicts import ModelVerdict

_F_P, _WHITE_P, _PULL = 0.01, 0.001, 3.0
_F_QUIET = 200  # samples before the impact for the F test to decide alone
_UNSURE = 2.0  # factor on the estimated error of a simulation


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
    problem: FitProblem, iterate: Iterate, until_s: float, allowed_at_bound: set[str]
) -> ModelAssessment:
    """Judge the class of models by the residual of a fit.

    Args:
        problem: the fit.
        iterate: its solution, with the model taken as exact.
        until_s: end of the last window after the touch, s.
        allowed_at_bound: keys that a one-sided verdict explains.
    """
    tests = _ResidualTests(problem, iterate, until_s)
    for index in range(len(problem.channels)):
        tests.add(index)
    f_p, white_p = tests.f_p, tests.white_p
    pulls = problem.prior_pulls(iterate.x)
    at_bound = {
        f.key: side
        for f, x in zip(problem.varied_keys, iterate.x, strict=False)
        if (side := f.at_bound(float(x)))
    }
    unsure = f_p is not None and f_p < _F_P <= tests.beyond * tests.count
    reasons: list[str] = []
    if f_p is not None and f_p < _F_P and not unsure:
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
        if key not in allowed_at_bound:
            reasons.append(
                f"{key} is at a bound of its range, the {side} one. Widen the range with --free "
                f"{key}=LOW:HIGH, or check the other values of the scene."
            )
    if reasons:
        verdict = ModelVerdict.DOES_NOT_FIT
    elif unsure:
        verdict = ModelVerdict.CANNOT_TELL
        reasons.append(f"{tests.shown}. {_coarse_simulation(problem)}")
    elif f_p is None or not tests.quiet_known:
        verdict = ModelVerdict.CANNOT_TELL
        reasons.append(
            f"Fewer than {ENOUGH_QUIET} samples before the impact: the noise is not known well "
            "enough to test the residual against it."
        )
    else:
        verdict = ModelVerdict.FITS
    ratio = tests.residual_over_noise
    return ModelAssessment(verdict, ratio, f_p, white_p, pulls, list(at_bound), reasons)


def _coarse_simulation(problem: FitProblem) -> str:
    """Return sentences on the error of the simulation, and what to do."""
    worst = max(problem.channels, key=lambda c: c.simulation_error)
    return (
        "The error of the simulation can explain that: during contact it is about "
        f"{worst.simulation_error:.2g} times the noise of {worst.record.name}. A finer simulation "
        f"of {1e3 * worst.duration_s:.3g} ms would take too long. Cut the record sooner after the "
        "impact."
    )


class _ResidualTests:
    """Tests of the residual of a fit, one channel after the other.

    Attributes:
        count: number of F tests.
        smallest: least probability of them, and `shown`: a sentence on the residual of that test.
        beyond: least probability if the error of a coarse simulation is a part of the noise.
        whiteness: least probability of the Ljung-Box tests.
        quiet_known: whether enough samples before the impact tell the noise.
    """

    def __init__(self, problem: FitProblem, iterate: Iterate, until_s: float) -> None:
        self.problem, self.iterate, self.until_s = problem, iterate, until_s
        self.contact_s = max(m.contact_s for m in problem.models)
        self.count, self.shown = 0, ""
        self.smallest = self.beyond = self.whiteness = 1.0
        self.quiet_known = True
        self._squares, self._samples = 0.0, 0.0

    def add(self, index: int) -> None:
        """Test a channel."""
        c, x = self.problem.channels[index], self.iterate.x
        rows = self.iterate.residual[self.iterate.channel_rows[index]]
        touch_s, ppm, _, _ = self.problem.nuisances(x, index)
        tau = c.after_touch_s(touch_s, ppm)
        counted = c.counted(tau <= self.until_s)
        tau, size = tau[counted], c.independent(counted)
        after = tau > -0.1 * self.contact_s
        self._squares += float(rows[after] @ rows[after])
        self._samples += float(np.sum(size[after]))
        self.whiteness = min(self.whiteness, _whiteness(c, rows[after]))
        if c.noise_unknown:
            enough = c.noise_from != "residual" and c.quiet >= _F_QUIET
            self.quiet_known = self.quiet_known and enough
            return
        self._compare_with_noise(c, rows, tau, size)

    def _compare_with_noise(
        self, c: Channel, rows: np.ndarray, tau: np.ndarray, size: np.ndarray
    ) -> None:
        """Compare the residual of three windows with the noise by F tests.

        Args:
            c: the channel.
            rows: residual over noise, (samples,).
            tau: times after the touch, s, (samples,).
            size: how many independent samples each one is, (samples,).
        """
        share = len(self.iterate.x) / max(len(self.problem.channels), 1)
        known = c.quiet // 2 if len(c.ar) else c.quiet  # colour and size from the same samples
        known = min(known, c.equivalent_samples or known)
        after = tau > -0.1 * self.contact_s
        in_contact = np.sum(size[(tau > 0.0) & (tau < 1.3 * self.contact_s)])
        for end in (1.3 * self.contact_s, 12.0 * self.contact_s, math.inf):
            inside = after & (tau < end)
            part, samples = rows[inside], float(np.sum(size[inside]))
            used = share if end == math.inf else share * min(1.0, samples / float(np.sum(size)))
            free = samples - used
            if free < 8 or (end != math.inf and np.sum(inside) == np.sum(after)):
                continue
            self.count += 1
            ratio = float(part @ part) / free
            p = float(scipy.stats.f.sf(ratio, free, known - 1))
            if p < self.smallest:
                self.smallest = p
                within = "" if end == math.inf else f" in the first {1e6 * end:.3g} us"
                self.shown = f"The residual{within} is {math.sqrt(ratio):.3g} times the noise"
            ratio /= 1.0 + (_UNSURE * c.simulation_error) ** 2 * in_contact / free
            self.beyond = min(self.beyond, float(scipy.stats.f.sf(ratio, free, known - 1)))

    @property
    def f_p(self) -> float | None:
        """Least probability of the F tests, corrected for their number; None without any."""
        return min(1.0, self.smallest * self.count) if self.count else None

    @property
    def white_p(self) -> float:
        """Least probability of the Ljung-Box tests, corrected for their number."""
        return min(1.0, self.whiteness * len(self.problem.channels))

    @property
    def residual_over_noise(self) -> float:
        """Residual of all channels over their noise, root mean square."""
        return math.sqrt(self._squares / max(self._samples - len(self.iterate.x), 1.0))


def _whiteness(c: Channel, rows: np.ndarray) -> float:
    """Probability that white noise has the correlations of a residual; 1 where the errors of a
    converter or of the simulation, which are not white, are larger than the noise."""
    if c.limited_by_simulation or c.simulation_error or (c.step > 0.0 and c.noise < 0.7 * c.step):
        return 1.0
    if len(rows) <= 30:
        return 1.0
    return ljung_box(rows, whitened_by=c.quiet if len(c.ar) else 0)
