"""Least squares: scene keys and nuisances of the records, with growing windows and priors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hertzloop.scenes.errors import SceneError
from hertzloop.studies.fit.channel import Channel
from hertzloop.studies.fit.model import FrozenModel
from hertzloop.studies.fit.observation import Chain, Observed, observe

NUISANCES = ("time_shift_s", "clock_ppm", "gain", "offset")
_PER_CHANNEL = len(NUISANCES)
_DIFFERENCE = 1e-4  # of a key, for central differences
_FIRST_WINDOW, _GROWTH = 1.5, 3.0  # contacts; from window to window
_EARLY_SPREADS = 6.0  # the early windows know a key to a sixth of its range
_OUTLIER = 4.0  # robust deviations
_MOST_OUTLIERS = 0.06
_LONGEST_RUN = 2  # outliers in a row; longer ones are a misfit
_SHIFT_UNIT = 1e-6  # s


@dataclass(frozen=True)
class Free:
    """A free scene key: starting value, bounds, and a prior as a relative standard deviation."""

    key: str
    start: float
    low: float
    high: float
    prior: float | None = None

    @property
    def spread(self) -> float:
        """Standard deviation of the logarithm that early windows take."""
        return math.log(self.high / self.low) / _EARLY_SPREADS


@dataclass
class Point:
    """A point of the parameter space with its residuals.

    `residual`: rows of all channels, whitened, then the priors, (rows,). `jacobian`: (rows,
    parameters). `rows`: the channel's rows, one slice for each.
    """

    x: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    rows: list[slice]

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals, priors included."""
        return float(self.residual @ self.residual)


@dataclass
class Problem:
    """Keys, channels and models of a fit.

    `models`: the frozen model of each channel (channels with the same setup share one). `chains`:
    as they are at the starting point; a free key of the sensor changes them.
    """

    free: Sequence[Free]
    channels: Sequence[Channel]
    models: Sequence[FrozenModel]
    chains: Sequence[Chain]
    fixed: dict[str, float] = field(default_factory=dict)
    evaluations: int = 0

    @property
    def moving(self) -> list[Free]:
        """The free keys that are not held at a value."""
        return [f for f in self.free if f.key not in self.fixed]

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Scene keys at a point."""
        found = dict(self.fixed)
        for f, value in zip(self.moving, x, strict=False):
            found[f.key] = float(np.clip(math.exp(value), f.low, f.high))
        return found

    def observed(self, index: int, values: dict[str, float], until_s: float) -> Observed:
        """What the chain of channel `index` shows with these keys. Raises SceneError."""
        model, channel = self.models[index], self.channels[index]
        given = channel.record.measured.set  # what holds for this record is not fitted in it
        of_plant = {
            k: v for k, v in values.items() if not k.startswith("sensors.") and k not in given
        }
        chain = self.chains[index]
        of_chain = {k.partition(".")[2]: v for k, v in values.items() if k.startswith("sensors.")}
        if of_chain and channel.record.quantity:
            chain = Chain(**(vars(chain) | of_chain))
        before = model.simulations
        simulated = model.run(of_plant, until_s)
        self.evaluations += model.simulations - before
        return observe(simulated, channel.record.quantity, chain, model.elsewhere)

    def start(self) -> np.ndarray:
        """The starting point: logarithms of keys, then the nuisances of every channel."""
        keys = [math.log(f.start) for f in self.moving]
        for c in self.channels:
            keys += [0.0, c.ppm, c.gain, c.offset / c.peak]
        return np.array(keys)

    def nuisances(self, x: np.ndarray, index: int) -> tuple[float, float, float, float]:
        """Touch (s), clock error (ppm), gain and offset of a channel."""
        c = self.channels[index]
        at = len(self.moving) + _PER_CHANNEL * index
        shift, ppm, gain, offset = (float(v) for v in x[at : at + _PER_CHANNEL])
        return c.touch_s + shift * _SHIFT_UNIT, ppm, gain, offset * c.peak

    def predicted(
        self, x: np.ndarray, index: int, until_s: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What channel `index` should read, without gain and offset; its slope by time, 1/s; and
        the times after the touch, s; (samples,) each."""
        touch_s, ppm, _, _ = self.nuisances(x, index)
        tau = self.channels[index].after_touch_s(touch_s, ppm)
        seen = self.observed(index, self.values(x), until_s)
        inside = tau <= until_s
        value, slope = np.zeros(len(tau)), np.zeros(len(tau))
        value[inside], slope[inside] = seen.value(tau[inside]), seen.slope(tau[inside])
        return value, slope, tau

    def point(self, x: np.ndarray, until_s: float, early: bool, jacobian: bool = True) -> Point:
        """Residuals and their derivatives with the samples up to `until_s` after the touch.

        Args:
            x: parameters.
            until_s: end of the window, s.
            early: whether weak priors hold the keys near their start.
            jacobian: whether derivatives are wanted.

        Raises:
            SceneError: a value that the scene refuses.
        """
        moving, n = self.moving, len(x)
        parts, columns, rows, at = [], [], [], 0
        for index, c in enumerate(self.channels):
            _, ppm, gain, offset = self.nuisances(x, index)
            value, slope, tau = self.predicted(x, index, until_s)
            good = c.counted(tau <= until_s)
            raw = np.where(c.kept & (tau <= until_s), gain * value + offset - c.value, 0.0)
            white = c.whitened(raw)[good]
            parts.append(white)
            rows.append(slice(at, at + len(white)))
            at += len(white)
            if not jacobian:
                continue
            block = np.zeros((len(tau), n))
            for j, f in enumerate(moving):
                block[:, j] = gain * self._by_key(x, index, until_s, j, f, tau)
            where = len(moving) + _PER_CHANNEL * index
            stretch = 1.0 + 1e-6 * ppm
            block[:, where] = -gain * slope * _SHIFT_UNIT / stretch
            block[:, where + 1] = -gain * slope * tau * 1e-6 / stretch
            block[:, where + 2] = value
            block[:, where + 3] = c.peak
            block[~(c.kept & (tau <= until_s))] = 0.0
            columns.append(c.whitened(block)[good])
        prior, by = self._priors(x, early)
        return Point(
            x, np.concatenate([*parts, prior]),
            np.concatenate([*columns, by]) if jacobian else np.empty((0, n)), rows,
        )  # fmt: skip

    def _by_key(
        self, x: np.ndarray, index: int, until_s: float, j: int, f: Free, tau: np.ndarray
    ) -> np.ndarray:
        """Derivative by the logarithm of key `j`, central difference; one-sided at a bound."""
        up, down = x.copy(), x.copy()
        up[j] = min(x[j] + _DIFFERENCE, math.log(f.high))
        down[j] = max(x[j] - _DIFFERENCE, math.log(f.low))
        inside = tau <= until_s
        found = np.zeros(len(tau))
        one = self.observed(index, self.values(up), until_s).value(tau[inside])
        other = self.observed(index, self.values(down), until_s).value(tau[inside])
        found[inside] = (one - other) / (up[j] - down[j])
        return found

    def _priors(self, x: np.ndarray, early: bool) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the priors and their derivatives."""
        rows, by, n = [], [], len(x)

        def row(place: int, centre: float, sd: float) -> None:
            rows.append((x[place] - centre) / sd)
            line = np.zeros(n)
            line[place] = 1.0 / sd
            by.append(line)

        for j, f in enumerate(self.moving):
            if f.prior is not None:
                row(j, math.log(f.start), f.prior)
            elif early:
                row(j, math.log(f.start), f.spread)
        for index, c in enumerate(self.channels):
            at = len(self.moving) + _PER_CHANNEL * index
            measured = c.record.measured
            row(at + 1, 0.0, max(measured.clock_tolerance_ppm, 1e-6))
            row(at + 2, 1.0, max(measured.sensitivity_uncertainty, 1e-9))
        return np.array(rows), np.array(by).reshape(-1, n)

    def pulls(self, x: np.ndarray) -> dict[str, float]:
        """How far each prior is pulled, in standard deviations, by name."""
        found = {}
        for j, f in enumerate(self.moving):
            if f.prior is not None:
                found[f.key] = (float(x[j]) - math.log(f.start)) / f.prior
        for index, c in enumerate(self.channels):
            _, ppm, gain, _ = self.nuisances(x, index)
            m = c.record.measured
            found[f"{c.record.name}: clock_ppm"] = ppm / max(m.clock_tolerance_ppm, 1e-6)
            found[f"{c.record.name}: gain"] = (gain - 1.0) / max(m.sensitivity_uncertainty, 1e-9)
        return found

    @property
    def longest_s(self) -> float:
        """From the touch to the last sample of the longest record, s."""
        return max(c.duration_s for c in self.channels)

    def windows_s(self) -> list[float]:
        """Ends of the growing windows after the touch, s; the last is infinite but for rounding."""
        end = _FIRST_WINDOW * max(m.contact_s for m in self.models)
        found = []
        while end < 0.6 * self.longest_s:
            found.append(end)
            end *= _GROWTH
        return [*found, 1.001 * self.longest_s + 2e-6]


def minimised(
    problem: Problem, x: np.ndarray, until_s: float, early: bool, steps: int = 40,
    tolerance: float = 1e-7,
) -> Point:  # fmt: skip
    """Minimise the squared residuals within the bounds by damped Gauss-Newton steps.

    Args:
        problem: what is fitted.
        x: where to start.
        until_s: end of the window after the touch, s.
        early: whether weak priors hold the keys near their start.
        steps: most steps.
        tolerance: relative fall of chi-square that ends it.

    Returns:
        The best point found, with its Jacobian.
    """
    low = np.full(len(x), -np.inf)
    high = np.full(len(x), np.inf)
    for j, f in enumerate(problem.moving):
        low[j], high[j] = math.log(f.low), math.log(f.high)
    x = np.clip(x, low, high)
    now = problem.point(x, until_s, early)
    damping = 1e-3
    for _ in range(steps):
        scale = np.sqrt(np.sum(now.jacobian**2, axis=0))
        scale[scale == 0.0] = 1.0
        gradient = now.jacobian.T @ now.residual
        # Parameters that a bound holds do not take part.
        held = ((x <= low) & (gradient > 0.0)) | ((x >= high) & (gradient < 0.0))
        open_ = np.flatnonzero(~held)
        j = now.jacobian[:, open_] / scale[open_]
        improved = False
        for _ in range(8):
            big = np.concatenate([j, math.sqrt(damping) * np.eye(len(open_))])
            wanted = np.concatenate([-now.residual, np.zeros(len(open_))])
            move = np.linalg.lstsq(big, wanted, rcond=None)[0] / scale[open_]
            new = x.copy()
            new[open_] += _limited(problem, move, open_)
            new = np.clip(new, low, high)
            try:
                tried = problem.point(new, until_s, early, jacobian=False)
            except SceneError:
                damping *= 10.0
                continue
            if tried.chi_square < now.chi_square:
                improved = True
                break
            damping = max(damping * 6.0, 1e-6)
        if not improved:
            break
        fall = now.chi_square - tried.chi_square
        x = new
        now = problem.point(x, until_s, early)
        damping = max(damping * 0.1, 1e-9)
        if fall < tolerance * (1.0 + now.chi_square):
            break
    return now


def _limited(problem: Problem, move: np.ndarray, places: np.ndarray) -> np.ndarray:
    """A step that changes no key by more than a third: beyond, derivatives mean little."""
    keys = places < len(problem.moving)
    if not np.any(keys):
        return move
    most = float(np.max(np.abs(move[keys]))) if np.any(keys) else 0.0
    return move * min(1.0, 0.3 / most) if most > 0.3 else move


def reject_outliers(problem: Problem, point: Point, until_s: float) -> int:
    """Take isolated samples out that are more than four robust deviations away.

    Returns:
        How many there were. A run of more than two is a misfit and stays, as do all if they are
        more than 6 % of a record.
    """
    rejected = 0
    for index, c in enumerate(problem.channels):
        value, _, tau = problem.predicted(point.x, index, until_s)
        _, _, gain, offset = problem.nuisances(point.x, index)
        residual = np.where(c.kept, gain * value + offset - c.value, 0.0)
        used = c.kept & (tau <= until_s)
        if np.count_nonzero(used) < 20:
            continue
        sd = 1.4826 * float(np.median(np.abs(residual[used])))
        sd = max(sd, c.noise if c.noise_from == "quiet" else 0.0, 0.5 * c.step)
        far = used & (np.abs(residual) > _OUTLIER * sd)
        runs = np.split(np.flatnonzero(far), np.flatnonzero(np.diff(np.flatnonzero(far)) > 1) + 1)
        single = [i for run in runs if 0 < len(run) <= _LONGEST_RUN for i in run]
        if len(single) > _MOST_OUTLIERS * np.count_nonzero(used):
            continue
        # Of Gauss's noise 6 samples of 100 000 are as far out; these cost nothing.
        if single:
            c.kept = c.kept.copy()
            c.kept[np.array(single)] = False
            c.rejected += len(single)
            rejected += len(single)
    return rejected
