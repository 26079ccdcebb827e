"""What records know of the keys: covariance of their logarithms, and 95 % intervals."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hertzloop.fitting.fit.free_keys import PRESSURE_KEY, FreeKey
from hertzloop.fitting.fit.minimise import minimise
from hertzloop.fitting.fit.parameters import prior_pulls
from hertzloop.fitting.fit.problem import FitProblem, Iterate
from hertzloop.fitting.fit.results import NORMAL, WIDEST, Estimate, KeyVerdict, half_width
from hertzloop.fitting.fit.step_scan import CHI_SQUARE_95, StepProfile
from hertzloop.scene.errors import SceneError

_NULL = 1e-10  # of the largest singular value
_TOUCHED = 1e-6  # share of a direction of which nothing is known, that makes a key unknown
# Of intervals of a model with a discrepancy, which is not as random as a process: the factor on
# their width, and the discrepancy of the model's time over that of its size. Both were chosen with
# `python -m benchmarks.fit_discrepancy`.
_WIDER, _STRETCH = 2.0, 0.3
_STEPS_KNOWN = 1.5  # half-width in steps with which a key in whole steps is identified in any case
_YIELDED = 10.827566170662733  # at 99.9 %: yielding sets an upper limit only if it is this sure
_CLEAR = 30.0  # rise of chi-square beyond which the quadratic interval of a pressure is right
_ONE_SIDED = 2.705543454095404  # at 95 % on one side


@dataclass
class KeyUncertainty:
    """What the samples know of the keys' logarithms.

    Attributes:
        covariance: (keys, keys), inf where nothing is known.
        alone: standard deviation of each key if all other keys were known, (keys,).
        wider: factor on intervals that a discrepancy brings.
    """

    covariance: np.ndarray
    alone: np.ndarray
    wider: float = 1.0

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations of the logarithms, (keys,)."""
        return np.sqrt(np.diag(self.covariance))


def key_uncertainty(
    problem: FitProblem, iterate: Iterate, shifts: Sequence[np.ndarray] = ()
) -> KeyUncertainty:
    """Return the covariance of the keys with all nuisances free.

    The columns of the Jacobian are scaled to length one first, and no direction is cut off: an
    unscaled pseudo-inverse would call the least known direction the best known one.

    Args:
        problem: the fit.
        iterate: where, with its Jacobian.
        shifts: of the keys' logarithms that parts of the records show, (keys,) each.
    """
    n = len(problem.varied_keys)
    jacobian = iterate.jacobian
    length = np.sqrt(np.sum(jacobian**2, axis=0))
    safe = np.where(length > 0.0, length, 1.0)
    scaled = jacobian / safe
    # Nuisances first: what is left of the keys' columns is what only the keys can explain.
    order = [*range(n, jacobian.shape[1]), *range(n)]
    r = np.asarray(np.linalg.qr(scaled[:, order], mode="r"))
    rest = r[-n:, -n:] if n else np.empty((0, 0))
    alone = np.sqrt(np.sum(rest**2, axis=0)) * safe[:n]
    alone = np.divide(1.0, alone, out=np.full(n, np.inf), where=alone > 0.0)
    _, s, v = np.linalg.svd(rest)
    known = s > _NULL
    # Columns: change of the logarithms by a unit step.
    directions = v[known].T / safe[:n, np.newaxis] / s[known]
    covariance = directions @ directions.T
    unknown = np.any(np.abs(v[~known]) > _TOUCHED, axis=0)
    covariance[unknown, unknown] = np.inf
    wider = _WIDER if problem.has_discrepancy else 1.0
    if wider > 1.0:
        covariance = wider**2 * (covariance + _covariance_by_shared_discrepancy(problem, iterate))
        covariance += sum((np.outer(m, m) for m in shifts), np.zeros((n, n)))
    return KeyUncertainty(covariance, wider * alone, wider)


def _covariance_by_shared_discrepancy(problem: FitProblem, iterate: Iterate) -> np.ndarray:
    """Covariance of the keys' logarithms by a discrepancy that a whole record shares: of its
    size and of its time, each limited by the prior of a gain or of a clock."""
    n = len(problem.varied_keys)
    found = np.zeros((n, n))
    sds: dict[int, float] = {}
    for c, indices in zip(problem.channels, problem.nuisance_indices, strict=True):
        share = 0.0 if c.discrepancy is None else c.discrepancy.overall
        for at, sd in ((indices.gain, share), (indices.clock, 1e6 * _STRETCH * share)):
            sds[at] = max(sds.get(at, 0.0), sd)
    if not any(sds.values()):
        return found
    inverse = iterate.pseudo_inverse(_NULL)
    for at, sd in sds.items():
        moved = sd * (inverse[:n, iterate.prior_rows] @ iterate.jacobian[iterate.prior_rows, at])
        found += np.outer(moved, moved)
    return found


def estimate_from_covariance(
    f: FreeKey, value: float, sd: float, alone: float, pull: float | None
) -> Estimate:
    """Return an estimate with the interval of the covariance.

    Args:
        f: the key.
        value: its estimate, in its unit.
        sd: standard deviation of the natural logarithm; inf if nothing is known.
        alone: the same if all other keys were known.
        pull: distance from the prior in its standard deviations; None without a prior.
    """
    half, half_alone = half_width(sd), half_width(alone)
    known = half < math.inf
    low = value * math.exp(-NORMAL * sd) if known else None
    high = value * math.exp(NORMAL * sd) if known else None
    verdict = KeyVerdict.IDENTIFIED if half <= WIDEST else KeyVerdict.NOT_IDENTIFIABLE
    percent = 100.0 * half_alone if half_alone < math.inf else None
    return Estimate(f.key, value, low, high, verdict, f.start, sd if known else None, pull, percent)


def estimate_keys(problem: FitProblem, iterate: Iterate, known: KeyUncertainty) -> list[Estimate]:
    """Return estimates of all keys."""
    pulls = prior_pulls(problem, iterate.x)
    found = []
    for j, f in enumerate(problem.varied_keys):
        value = problem.key_values(iterate.x)[f.key]
        sd, alone = float(known.sd[j]), float(known.alone[j])
        estimate = estimate_from_covariance(f, value, sd, alone, pulls.get(f.key))
        at_bound = f.at_bound(iterate.x[j])
        doubtful = at_bound or estimate.verdict is not KeyVerdict.IDENTIFIED
        # Where a key is unknown even with all others known, no combination is to blame.
        flat = at_bound or half_width(alone) > WIDEST
        if f.prior is None and (f.key == PRESSURE_KEY or (doubtful and flat)):
            rise = _chi_square_rise(problem, iterate, j, known.wider)
            profiled = _open_end(f, estimate, rise)
            estimate = profiled or estimate
        found.append(_beyond_bound(estimate, at_bound))
    return found


def add_discrete_estimate(
    problem: FitProblem,
    estimates: list[Estimate],
    known: KeyUncertainty,
    profile: StepProfile | None,
) -> list[Estimate]:
    """Return the estimates with that of the discrete key, which widens the intervals of the
    others where several of its values are certain; the covariance gets a row of zeros for it."""
    if profile is None:
        return estimates
    f, found = profile.free, []
    for j, e in enumerate(estimates):
        if e.low is not None and e.high is not None and e.sd_log is not None:
            down, up = profile.spread(j, e.sd_log)
            e = replace(e, low=e.value * math.exp(down), high=e.value * math.exp(up))
            if e.verdict is KeyVerdict.IDENTIFIED and math.sinh(0.5 * (up - down)) > WIDEST:
                e = replace(e, verdict=KeyVerdict.NOT_IDENTIFIABLE)
        found.append(e)
    low, high = profile.interval()
    value = profile.best * f.step
    verdict = KeyVerdict.NOT_IDENTIFIABLE
    if low is not None and high is not None:
        # The interval of a single step is one step wide, which is all that can be known.
        widest = max(WIDEST * value, _STEPS_KNOWN * f.step)
        if 0.5 * (high - low) <= widest:
            verdict = KeyVerdict.IDENTIFIED
    place = [g.key for g in problem.free].index(f.key)
    own = Estimate(f.key, value, low, high, verdict, f.start, None, resolution=f.resolution)
    found.insert(place, own)
    for axis in (0, 1):
        known.covariance = np.insert(known.covariance, place, 0.0, axis=axis)
    return found


def _beyond_bound(e: Estimate, at_bound: str) -> Estimate:
    """Return the estimate of a key, with the verdict "at its bound" where it ended there: then the
    range made the value, and the records may ask for one beyond."""
    if not at_bound or e.verdict is not KeyVerdict.IDENTIFIED:
        return e
    low, high = (None, e.high) if at_bound == "low" else (e.low, None)
    return replace(e, low=low, high=high, verdict=KeyVerdict.AT_BOUND, sd_log=None)


def _chi_square_rise(
    problem: FitProblem, iterate: Iterate, j: int, wider: float
) -> Callable[[float], float]:
    """Return the profile of key `j`: how far chi-square rises if the key is held at a value and all
    other parameters are fitted; over the square of the factor `wider` on intervals."""
    f = problem.varied_keys[j]

    def rise(value: float) -> float:
        held, x = problem.hold({f.key: value}), np.delete(iterate.x, j)
        try:
            found = minimise(held, x, iterate.until_s, steps=12, tolerance=1e-4)
        except SceneError:  # with the other values, the scene cannot have this one
            return math.inf
        return (found.chi_square - iterate.chi_square) / wider**2

    return rise


def _open_end(f: FreeKey, estimate: Estimate, rise: Callable[[float], float]) -> Estimate | None:
    """Return an estimate with one open end where the profile stays flat to a bound, else None."""
    up = rise(f.high)
    if up < (_YIELDED if f.key == PRESSURE_KEY else CHI_SQUARE_95):
        # The high side is open. Find the largest value below at which chi-square has risen.
        edge = _crossing(rise, estimate.value, f.low)
        if edge is None:
            return None
        # A contact that does not yield sets a limit by itself; another key is just not known.
        verdict = KeyVerdict.ONE_SIDED if f.key == PRESSURE_KEY else estimate.verdict
        return replace(estimate, low=edge, high=None, verdict=verdict, sd_log=None)
    if f.key == PRESSURE_KEY:
        # Above the largest pressure of the impact chi-square is flat: the interval is not even.
        edge = _crossing(rise, estimate.value, f.high, CHI_SQUARE_95) if up < _CLEAR else None
        high = estimate.high
        return None if edge is None or high is None else replace(estimate, high=max(edge, high))
    edge = _crossing(rise, estimate.value, f.high) if rise(f.low) < CHI_SQUARE_95 else None
    return None if edge is None else replace(estimate, low=None, high=edge, sd_log=None)


def _crossing(
    rise: Callable[[float], float], value: float, bound: float, level: float = _ONE_SIDED
) -> float | None:
    """Return the value at which a profile has risen by a level, by default the one-sided one of
    95 %, between a value and a bound; None if it has not at the bound."""
    if rise(bound) < level:
        return None
    inner, outer = math.log(value), math.log(bound)
    for _ in range(10):
        middle = 0.5 * (inner + outer)
        if rise(math.exp(middle)) < level:
            inner = middle
        else:
            outer = middle
        if abs(outer - inner) < 3e-3:
            break
    return math.exp(outer)
