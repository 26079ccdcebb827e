"""What a fit may claim: intervals, identifiability, and whether the model class fits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
import scipy

from hertzloop.identification.fit.channel import ENOUGH_QUIET, ljung_box
from hertzloop.identification.fit.solve import Point, Problem

WIDEST = 0.30  # relative half-width of an identified key
NORMAL = 1.959963984540054  # 95 %
NO_BOUND = 10.0  # half-widths of logarithms beyond this mean nothing
_NULL = 1e-10  # of the largest singular value
_F_P, _WHITE_P, _PULL = 0.01, 0.001, 3.0
_F_QUIET = 200  # samples before the impact for the F test to decide alone
_DRAWS = 300
_UNSURE = 2.0  # factor on the estimated error of a simulation
# Of intervals of a model with an error, which is not as random as a process: the factor on their
# width, and the error of the model's time over that of its size. Both were chosen with
# `python -m benchmarks.fit_discrepancy`.
_WIDER, _STRETCH = 2.0, 0.3
_SHOWN = 0.05  # exponents of a combination below this are left away


class Verdict(StrEnum):
    """Verdict on a key."""

    IDENTIFIED = "identified"
    ONE_SIDED = "one-sided"
    NOT_IDENTIFIABLE = "not identifiable"
    AT_BOUND = "at its bound"


class Model(StrEnum):
    """Verdict on the class of models."""

    FITS = "fits"
    DOES_NOT_FIT = "does not fit"
    CANNOT_TELL = "cannot tell"


@dataclass(frozen=True)
class Combination:
    """A product of keys: exponents by key, and its 95 % half-width, %; inf if nothing is known."""

    exponents: dict[str, float]
    half_width_percent: float

    def __str__(self) -> str:
        parts = []
        for key, power in self.exponents.items():
            parts.append(key if abs(power - 1.0) < 5e-3 else f"{key}^{power:.2g}")
        return " * ".join(parts)


@dataclass
class Uncertainty:
    """What the samples know of the keys' logarithms.

    `covariance`: (keys, keys), inf where nothing is known. `alone`: standard deviation of each key
    if all other keys were known, (keys,). `combinations`: from the worst known to the best.
    `wider`: the factor that an error of the model brings.
    """

    covariance: np.ndarray
    alone: np.ndarray
    combinations: list[Combination]
    wider: float = 1.0

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations of the logarithms, (keys,)."""
        return np.sqrt(np.diag(self.covariance))

    def half_widths(self) -> np.ndarray:
        """Relative 95 % half-widths, (keys,)."""
        with np.errstate(over="ignore"):
            return np.asarray(np.expm1(np.minimum(NORMAL * self.sd, 700.0)))


def uncertainty(problem: Problem, point: Point, moved: Sequence[np.ndarray] = ()) -> Uncertainty:
    """Return the covariance of the keys with all nuisances free.

    The columns of the Jacobian are scaled to length one first, and no direction is cut off: an
    unscaled pseudo-inverse would call the least known direction the best known one.

    Args:
        problem: the fit.
        point: where, with its Jacobian.
        moved: errors of the keys' logarithms that parts of the records show, (keys,) each.
    """
    keys = [f.key for f in problem.moving]
    n = len(keys)
    jacobian = point.jacobian
    length = np.sqrt(np.sum(jacobian**2, axis=0))
    safe = np.where(length > 0.0, length, 1.0)
    scaled = jacobian / safe
    # Nuisances first: what is left of the keys' columns is what only the keys can explain.
    order = [*range(n, jacobian.shape[1]), *range(n)]
    r = np.asarray(np.linalg.qr(scaled[:, order], mode="r"))
    rest = r[-n:, -n:] if n else np.empty((0, 0))
    alone_r = np.sqrt(np.sum(rest**2, axis=0)) * safe[:n]
    _, s, v = np.linalg.svd(rest)
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = np.where(s > _NULL, 1.0 / np.maximum(s, 1e-300), np.inf)
        # Columns: change of the logarithms by a unit step.
        directions = np.asarray(v).T / safe[:n, np.newaxis]
        covariance = (directions * np.where(np.isfinite(spread), spread, 0.0) ** 2) @ directions.T
        for i, infinite in enumerate(~np.isfinite(spread)):
            if infinite:
                touched = np.abs(v[i]) > 1e-6
                covariance[touched, touched] = np.inf
        for j in range(n):
            if length[j] == 0.0:
                covariance[j, :] = covariance[:, j] = 0.0
                covariance[j, j] = np.inf
        alone = np.where(alone_r > 0.0, 1.0 / np.maximum(alone_r, 1e-300), np.inf)
    wider = _WIDER if any(c.discrepancy is not None for c in problem.channels) else 1.0
    if wider > 1.0:
        covariance = wider**2 * (covariance + _common(problem, point))
        covariance += sum((np.outer(m, m) for m in moved), np.zeros((n, n)))
    return Uncertainty(covariance, wider * alone, _combinations(keys, covariance), wider)


def _common(problem: Problem, point: Point) -> np.ndarray:
    """Covariance of the keys' logarithms by errors of the model that a whole record shares: of its
    size and of its time, each as large as the prior of a gain or of a clock lets it act."""
    n = len(problem.moving)
    found = np.zeros((n, n))
    sds: dict[int, float] = {}
    for c, place in zip(problem.channels, problem.places, strict=True):
        share = 0.0 if c.discrepancy is None else c.discrepancy.overall
        for at, sd in ((place[2], share), (place[1], 1e6 * _STRETCH * share)):
            sds[at] = max(sds.get(at, 0.0), sd)
    if not any(sds.values()):
        return found
    inverse = point.inverse(_NULL)
    for at, sd in sds.items():
        moved = sd * (inverse[:n, point.priors] @ point.jacobian[point.priors, at])
        found += np.outer(moved, moved)
    return found


def _combinations(keys: list[str], covariance: np.ndarray) -> list[Combination]:
    """The principal directions of the logarithms: the worst known product of keys first."""
    if len(keys) < 2 or not np.all(np.isfinite(covariance)):
        return [
            Combination({key: 1.0}, math.inf)
            for key, value in zip(keys, np.diag(covariance), strict=True)
            if not math.isfinite(value)
        ]
    values, vectors = np.linalg.eigh(covariance)
    found = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        largest = vector[np.argmax(np.abs(vector))]
        powers = {
            key: float(power / largest)
            for key, power in zip(keys, vector, strict=True)
            if abs(power / largest) >= _SHOWN
        }
        # The product with these exponents changes by |exponents|^2 along the direction.
        length = math.sqrt(sum(p * p for p in powers.values()))
        sd = math.sqrt(max(float(value), 0.0)) * length
        wide = NORMAL * sd > NO_BOUND
        found.append(Combination(powers, math.inf if wide else 100.0 * math.expm1(NORMAL * sd)))
    return found


def bootstrapped(problem: Problem, point: Point, until_s: float) -> np.ndarray | None:
    """Return the covariance of the keys' logarithms with errors of a converter drawn anew.

    A converter whose step is larger than the noise makes errors that are neither white nor
    independent. Records are drawn around the fit, sent through the converter, and fitted by one
    linear step each.

    Returns:
        Shape (keys, keys); None where no record needs it, or the model has an error that hides
        those of the converter.
    """
    needs = [c.step > 0.0 and c.noise < 1.5 * c.step for c in problem.channels]
    n = len(problem.moving)
    erring = any(c.discrepancy is not None for c in problem.channels)
    if not any(needs) or n == 0 or erring:
        return None
    length = np.sqrt(np.sum(point.jacobian**2, axis=0))
    length[length == 0.0] = 1.0
    scaled = point.jacobian / length
    inverse = np.linalg.pinv(scaled, rcond=_NULL)
    sd = np.sqrt(np.sum(inverse**2, axis=1)) / length
    if np.any(sd[:n] > 0.3):
        return None
    generator = np.random.default_rng(0)
    parts = []
    for index, c in enumerate(problem.channels):
        value, _, tau = predicted = problem.predicted(point.x, index, until_s)
        _, _, gain, offset = problem.nuisances(point.x, index)
        by = problem.derivatives(point.x, index, until_s, predicted)  # without whitening
        parts.append((gain * value + offset, by, c.kept & (tau <= until_s)))
    errors = np.empty((_DRAWS, n))
    for draw in range(_DRAWS):
        moved = generator.standard_normal(len(sd)) * np.minimum(sd, 0.3) * 2.0
        rows = []
        for c, (model, by, used) in zip(problem.channels, parts, strict=True):
            true = model + by @ moved
            quiet = math.sqrt(max(c.noise**2 - c.step**2 / 12.0, 0.0))
            read = true + quiet * generator.standard_normal(len(true))
            if c.step > 0.0:
                phase = generator.uniform() * c.step
                read = np.round((read - phase) / c.step) * c.step + phase
            error = np.where(used, read - true, 0.0)
            rows.append(c.whitened(error)[c.counted(used)])
        priors = generator.standard_normal(len(point.residual) - sum(len(r) for r in rows))
        errors[draw] = (inverse @ np.concatenate([*rows, priors]))[:n] / length[:n]
    return np.asarray(np.atleast_2d(np.cov(errors.T)))


@dataclass
class Fitness:
    """Whether the model class fits, and why.

    `residual_over_noise`: of all channels. `f_p`: least probability of an F test of the residual
    against the noise before the impact, corrected for the number of windows; None without enough
    such samples. `white_p`: least probability of the Ljung-Box test of ten lags, corrected for the
    number of records. `pulls`: of priors, standard deviations. `reasons`: sentences.
    """

    verdict: Model
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


def fitness(
    problem: Problem, point: Point, until_s: float, parameters: int, allowed_at_bound: set[str]
) -> Fitness:
    """Judge the class of models by the residual of a fit.

    Args:
        problem: the fit.
        point: its solution.
        until_s: end of the last window after the touch, s.
        parameters: how many the samples had to determine.
        allowed_at_bound: keys that a one-sided verdict explains.
    """
    reasons: list[str] = []
    tests, shown = 0, ""
    smallest, beyond, whiteness = 1.0, 1.0, 1.0  # `beyond`: of what a coarse simulation explains
    quiet_known = True
    squares, count = 0.0, 0.0
    contact_s = max(m.contact_s for m in problem.models)
    share = parameters / max(len(problem.channels), 1)
    for index, c in enumerate(problem.channels):
        rows = point.residual[point.rows[index]]
        touch_s, ppm, _, _ = problem.nuisances(point.x, index)
        tau = c.after_touch_s(touch_s, ppm)
        counted = c.counted(tau <= until_s)
        tau, size = tau[counted], c.independent(counted)
        after = tau > -0.1 * contact_s
        squares += float(rows[after] @ rows[after])
        count += float(np.sum(size[after]))
        coloured = c.quiet if len(c.ar) else 0
        white = 1.0
        if np.count_nonzero(after) > 30:
            white = ljung_box(rows[after], whitened_by=coloured)
        if c.floored or c.coarse or (c.step > 0.0 and c.noise < 0.7 * c.step):
            white = 1.0  # the errors of a converter, or of the simulation, are not white
        whiteness = min(whiteness, white)
        if c.noise_unknown:
            quiet_known = quiet_known and c.noise_from != "residual" and c.quiet >= _F_QUIET
            continue
        known = c.quiet // 2 if len(c.ar) else c.quiet  # colour and size from the same samples
        known = min(known, c.alike or known)
        for end in (1.3 * contact_s, 12.0 * contact_s, math.inf):
            inside = after & (tau < end)
            part, samples = rows[inside], float(np.sum(size[inside]))
            used = share if end == math.inf else share * min(1.0, samples / float(np.sum(size)))
            free = samples - used
            if free < 8 or (end != math.inf and np.sum(after & (tau < end)) == np.sum(after)):
                continue
            tests += 1
            ratio = float(part @ part) / free
            p = float(scipy.stats.f.sf(ratio, free, known - 1))
            if p < smallest:
                smallest = p
                within = "" if end == math.inf else f" in the first {1e6 * end:.3g} us"
                shown = f"The residual{within} is {math.sqrt(ratio):.3g} times the noise"
            in_contact = np.sum(size[(tau > 0.0) & (tau < 1.3 * contact_s)])
            ratio /= 1.0 + (_UNSURE * c.coarse) ** 2 * in_contact / free
            beyond = min(beyond, float(scipy.stats.f.sf(ratio, free, known - 1)))
    f_p = min(1.0, smallest * tests) if tests else None
    white_p = min(1.0, whiteness * len(problem.channels))
    ratio = math.sqrt(squares / max(count - parameters, 1.0))
    pulls = problem.pulls(point.x)
    at_bound = {
        f.key: side
        for f, x in zip(problem.moving, point.x, strict=False)
        if (side := f.at_bound(float(x)))
    }
    unsure = f_p is not None and f_p < _F_P <= beyond * tests
    if f_p is not None and f_p < _F_P and not unsure:
        reasons.append(
            f"{shown}; with the right class of models that has a probability of {f_p:.1g}."
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
        verdict = Model.DOES_NOT_FIT
    elif unsure:
        verdict = Model.CANNOT_TELL
        worst = max(problem.channels, key=lambda c: c.coarse)
        reasons.append(
            f"{shown}. The error of the simulation can explain that: during contact it is about "
            f"{worst.coarse:.2g} times the noise of {worst.record.name}. A finer simulation of "
            f"{1e3 * worst.duration_s:.3g} ms would take too long. Cut the record sooner after the "
            "impact."
        )
    elif f_p is None or not quiet_known:
        verdict = Model.CANNOT_TELL
        reasons.append(
            f"Fewer than {ENOUGH_QUIET} samples before the impact: the noise is not known well "
            "enough to test the residual against it."
        )
    else:
        verdict = Model.FITS
    return Fitness(verdict, ratio, f_p, white_p, pulls, list(at_bound), reasons)
