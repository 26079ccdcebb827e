"""Decide whether the class of models fits the records.

The residual of the exact model is tested: the discrepancy that widens the intervals (`solution.py`)
excuses nothing here.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy

from hertzloop.fitting.fit.channel import ENOUGH_QUIET, Channel
from hertzloop.fitting.fit.discrepancy import PULSE
from hertzloop.fitting.fit.free_keys import values_for_record
from hertzloop.fitting.fit.intervals import KeyUncertainty
from hertzloop.fitting.fit.noise import ljung_box
from hertzloop.fitting.fit.parameters import prior_pulls
from hertzloop.fitting.fit.problem import ChannelIterate, FitProblem, Iterate
from hertzloop.fitting.fit.results import Estimate, KeyVerdict, ModelVerdict, Nuisance

_F_QUIET = 200  # samples before the impact for the F test to decide alone
_UNSURE = 2.0  # factor on the estimated error of a simulation
_F_P, _WHITE_P, _PULL = 0.01, 0.001, 3.0
_HELD_OUT = 2.0  # residual of held-out records over their noise, above which a model does not fit


class ResidualTests:
    """Tests of the residual of a fit, with the model taken as exact.

    Attributes:
        count: number of F tests.
        smallest: least probability of them, and `shown`: a sentence on the residual of that test.
        beyond: least probability if the error of a coarse simulation is a part of the noise.
        whiteness: least probability of the Ljung-Box tests.
        quiet_known: whether enough samples before the impact tell the noise.
    """

    def __init__(self, problem: FitProblem, iterate: Iterate) -> None:
        self.problem, self.iterate = problem, iterate
        self.contact_s = max(one.contact_s for one in problem.simulators)
        self.count, self.shown = 0, ""
        self.smallest = self.beyond = self.whiteness = 1.0
        self.quiet_known = True
        self._squares, self._samples = 0.0, 0.0
        for c, one in zip(problem.channels, iterate.channels, strict=True):
            self._add(c, one)

    def _add(self, c: Channel, one: ChannelIterate) -> None:
        """Test a channel."""
        rows = self.iterate.residual[one.rows]
        tau, size = one.predicted.tau[one.counted], c.independent(one.counted)
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
    estimates: Sequence[Estimate],
    held_out_over_noise: float,
) -> ModelAssessment:
    """Judge the class of models by the residual of a fit.

    Args:
        problem: the fit.
        iterate: its solution, with the model taken as exact.
        estimates: of the keys; one that is not identified may be at a bound.
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
    for e in estimates:
        if e.verdict is KeyVerdict.AT_BOUND:
            reasons.append(
                f"{e.key} is at a bound of its range, the {at_bound[e.key]} one. Widen the range "
                f"with --free {e.key}=LOW:HIGH, or check the other values of the scene."
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
        if any(e.verdict is KeyVerdict.NOT_IDENTIFIABLE for e in estimates):
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


def describe_nuisances(problem: FitProblem, iterate: Iterate) -> list[Nuisance]:
    """Return nuisance parameters and residual of every record."""
    found = []
    for index, (c, one) in enumerate(zip(problem.channels, iterate.channels, strict=True)):
        touch_s, ppm, gain, offset = problem.nuisances(iterate.x, index)
        rows = iterate.residual[one.rows]
        samples = independent_samples(c, one)
        shares = c.discrepancy.shares if c.discrepancy else (0.0, 0.0)
        contact_s = problem.simulators[index].contact_s
        found.append(
            Nuisance(
                c.record.name,
                touch_s,
                gain,
                offset,
                ppm,
                c.noise,
                math.sqrt(float(np.sum(rows**2)) / samples) if samples else math.nan,
                len(rows),
                c.rejected,
                *_residual_percent(c, one, contact_s, iterate.until_s),
                *(100.0 * share for share in shares),
            )
        )
    return found


def residual_curves(problem: FitProblem, iterate: Iterate) -> list[dict[str, np.ndarray]]:
    """Return measured and simulated values of every record over the time after the touch.

    Returns:
        Arrays `time_s` (s), `measured` and `simulated` (SI unit of the quantity) and `used` (bool)
        for each record, (samples,) each.
    """
    found = []
    for c, one in zip(problem.channels, iterate.channels, strict=True):
        inside = one.predicted.tau <= iterate.until_s
        found.append(
            {
                "time_s": one.predicted.tau[inside],
                "measured": c.value[inside],
                "simulated": one.predicted.reading[inside],
                "used": c.kept[inside],
            }
        )
    return found


def independent_samples(channel: Channel, one: ChannelIterate) -> float:
    """Return how many independent samples of a channel count."""
    return float(np.sum(channel.independent(one.counted)))


def impact_speeds(problem: FitProblem, values: dict[str, float]) -> tuple[float, float]:
    """Return the least and the largest impact speed of the records, m/s.

    Args:
        problem: the fit.
        values: scene keys that differ from those of its simulators.
    """
    speeds = [
        simulator.spec_of(values_for_record(values, c.record)).sphere.impact_speed_m_s
        for simulator, c in zip(problem.simulators, problem.channels, strict=True)
    ]
    return min(speeds), max(speeds)


def _residual_percent(
    c: Channel, one: ChannelIterate, contact_s: float, until_s: float
) -> tuple[float | None, float | None, float]:
    """Residual over the peak: its root mean square in the pulse and after it, None without samples
    there, and its largest value, %."""
    tau, residual = one.predicted.tau, one.predicted.reading - c.value
    used = c.kept & (tau <= until_s) & (tau > -0.1 * contact_s)
    pulse = tau < PULSE * contact_s

    def rms(some: np.ndarray) -> float | None:
        if not np.any(some):
            return None
        return 100.0 * math.sqrt(float(np.mean(residual[some] ** 2))) / c.peak

    largest = float(np.max(np.abs(residual[used]), initial=0.0))
    return rms(used & pulse), rms(used & ~pulse), 100.0 * largest / c.peak


def common_fields(
    problem: FitProblem,
    plain: Iterate,
    known: KeyUncertainty,
    assessment: ModelAssessment,
) -> dict[str, Any]:
    """Return fields of a result, by name.

    Args:
        problem: the fit.
        plain: its solution, with the model taken as exact.
        known: uncertainty of the keys.
        assessment: verdict on the model.
    """
    return {
        "nuisances": describe_nuisances(problem, plain),
        "noise_rms": problem.channels[0].noise,
        "residual_over_noise": assessment.residual_over_noise,
        "model": assessment.verdict,
        "statistics": assessment.as_json(),
        "reasons": assessment.reasons,
        "covariance": known.covariance,
        "notes": [note for c in problem.channels for note in c.notes],
        "evaluations": problem.counter.done,
    }
