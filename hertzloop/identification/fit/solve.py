"""Least squares: scene keys and nuisances of the records, with growing windows and priors."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hertzloop.identification.fit.channel import Channel
from hertzloop.identification.fit.loop_model import LoopModel, acts_by_law
from hertzloop.identification.fit.model import FrozenModel
from hertzloop.identification.fit.observation import Chain, Observed, observe
from hertzloop.identification.records.records import Record, of_chain
from hertzloop.scene.errors import SceneError

_DIFFERENCE = 1e-4  # of a key, for central differences
# Under a law; with converters, which round what it reads and commands; of a phase, in periods.
_DIFFERENCE_LOOP, _DIFFERENCE_ROUNDED, _DIFFERENCE_PHASE = 2e-3, 3e-2, 0.04
_JUMP = 4.0  # times as large a derivative on one side: the law decides otherwise there
_PHASE_SD = math.sqrt(1.0 / 12.0)  # of a phase that is uniform over a period
_MOST_PHASE = 0.1  # periods that a step changes a phase by
_FIRST_WINDOW, _GROWTH = 1.5, 3.0  # contacts; from window to window
_EARLY_SPREADS = 6.0  # the early windows know a key to a sixth of its range
_AT_BOUND = 1e-6  # of a logarithm
_OUTLIER = 4.0  # robust deviations
_MOST_OUTLIERS = 0.06
_FEW = 60  # samples of a pulse, none of which is taken out
_LONGEST_RUN = 2  # outliers in a row; longer ones are a misfit
_STEPS_OF_STAGE = 4  # of a minimisation, as expected
SHIFT_UNIT_S = 1e-6  # s


@dataclass(frozen=True)
class Free:
    """A free scene key: starting value, bounds, and a prior as a relative standard deviation.
    `grain`: how far apart its values are, of a key in whole steps."""

    key: str
    start: float
    low: float
    high: float
    prior: float | None = None
    grain: float | None = None

    @property
    def spread(self) -> float:
        """Standard deviation of the logarithm that early windows take."""
        return math.log(self.high / self.low) / _EARLY_SPREADS

    def at_bound(self, logarithm: float) -> str:
        """At which end of the range the logarithm of a value is, "low" or "high"; "" within."""
        if logarithm <= math.log(self.low) + _AT_BOUND:
            return "low"
        return "high" if logarithm >= math.log(self.high) - _AT_BOUND else ""


@dataclass
class Point:
    """A point of the parameter space with its residuals.

    `residual`: rows of all channels, whitened, then those of the model's errors, then the priors,
    (rows,). `jacobian`: (rows, parameters). `rows`: the channel's rows, one slice for each.
    `priors`: rows of the priors.
    """

    x: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    rows: list[slice]
    priors: slice

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals, priors included."""
        return float(self.residual @ self.residual)

    def inverse(self, least: float = 1e-15) -> np.ndarray:
        """Pseudo-inverse of the Jacobian with columns of length one, scaled back; shape
        (parameters, rows). `least`: singular value that counts, over the largest."""
        length = np.sqrt(np.sum(self.jacobian**2, axis=0))
        length[length == 0.0] = 1.0
        return np.linalg.pinv(self.jacobian / length, rcond=least) / length[:, np.newaxis]


def own_values(values: Mapping[str, float], record: Record) -> dict[str, float]:
    """The scene keys of a record: without those of its table, which are not fitted in it, and of
    keys `KEY[HIT]` only those of its hit, as KEY."""
    found = {}
    for key, value in values.items():
        name, _, hit = key.partition("[")
        if name not in record.measured.set and hit in ("", f"{record.hit}]"):
            found[name] = value
    return found


def of_loop(key: str) -> bool:
    """Whether a drop without control does not depend on a key."""
    return of_chain(key) or acts_by_law(key)


@dataclass
class Tally:
    """Simulations of a fit, with all of its problems: those `done`, and how many are `expected`.

    `on_progress`: is told both after each simulation.
    """

    on_progress: Callable[[int, int], None] = lambda done, expected: None
    done: int = 0
    expected: int = 0

    def add(self, simulations: int) -> None:
        """Count simulations."""
        self.done += simulations
        if simulations:
            self.on_progress(self.done, max(self.expected, self.done + 1))

    def expect(self, stages: int, keys: int) -> None:
        """Expect so many more minimisations of a problem with this number of keys."""
        self.expected = self.done + _STEPS_OF_STAGE * stages * (2 * keys + 2)


@dataclass
class Problem:
    """Keys, channels and models of a fit.

    `models`: the frozen model of each channel (channels with the same setup share one). `chains`:
    as they are at the starting point; a free key of the sensor changes them. `phases_held`: whether
    the phases stay as they are. `tally`: of the fit that the problem is a part of.
    """

    free: Sequence[Free]
    channels: Sequence[Channel]
    models: Sequence[FrozenModel]
    chains: Sequence[Chain]
    fixed: dict[str, float] = field(default_factory=dict)
    evaluations: int = 0
    phases_held: bool = False
    tally: Tally = field(default_factory=Tally)

    @property
    def moving(self) -> list[Free]:
        """The free keys that are not held at a value."""
        return [f for f in self.free if f.key not in self.fixed]

    @property
    def stepped(self) -> Free | None:
        """The free key in whole steps, if there is one; it is held at a value all the time."""
        return next((f for f in self.free if f.grain is not None), None)

    @property
    def places(self) -> list[tuple[int, ...]]:
        """Where the nuisances of every channel stand: shift, clock, gain, offset and, under a law,
        phase. Channels of one clock share shift, clock and phase; hits share the clock, and the
        gain of each sensor."""
        known: dict[tuple[str, object], int] = {}
        found: list[tuple[int, ...]] = []
        for index, (c, model) in enumerate(zip(self.channels, self.models, strict=True)):
            record, hit = c.record, c.record.hit > 0
            clock = record.measured.clock or index
            sensor = repr(replace(record.measured, clock=None, set={})) if hit else index
            of = {"shift": clock, "clock": "of hits" if hit else clock, "gain": sensor,
                  "offset": index}  # fmt: skip
            of |= {"phase": clock} if isinstance(model, LoopModel) else {}
            found.append(tuple(
                known.setdefault(key, len(self.moving) + len(known)) for key in of.items()
            ))  # fmt: skip
        return found

    @property
    def phases(self) -> dict[int, int]:
        """Where the phases stand, and the period of each in steps."""
        return {
            place[4]: model.period
            for place, model in zip(self.places, self.models, strict=True)
            if isinstance(model, LoopModel)
        }

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Scene keys at a point."""
        found = dict(self.fixed)
        for f, value in zip(self.moving, x, strict=False):
            found[f.key] = float(np.clip(math.exp(value), f.low, f.high))
        return found

    def observed(
        self, index: int, values: dict[str, float], until_s: float, phase: float = 0.5
    ) -> Observed:
        """What the chain of channel `index` shows with these keys. Raises SceneError."""
        model, channel = self.models[index], self.channels[index]
        of_plant = own_values(values, channel.record)
        chain = self.chains[index]
        own: dict[str, Any] = {k.partition(".")[2]: v for k, v in values.items() if of_chain(k)}
        if own and channel.record.quantity:
            chain = Chain(**(vars(chain) | own))
        before = model.simulations
        if isinstance(model, LoopModel):
            simulated = model.run(of_plant, until_s, phase)
        else:
            alone = {k: v for k, v in of_plant.items() if not of_loop(k)}
            simulated = model.run(alone, until_s)
        self.evaluations += model.simulations - before
        self.tally.add(model.simulations - before)
        return observe(simulated, channel.record.quantity, chain, model.elsewhere)

    def start(self) -> np.ndarray:
        """The starting point: logarithms of keys, then the nuisances of every channel."""
        places = self.places
        found = np.zeros(max((max(p) for p in places), default=-1) + 1)
        found[: len(self.moving)] = [math.log(f.start) for f in self.moving]
        for c, place in zip(self.channels, places, strict=True):
            found[list(place[1:4])] = c.ppm, c.gain, c.offset / c.peak
            found[list(place[4:])] = c.phase
        return found

    def nuisances(self, x: np.ndarray, index: int) -> tuple[float, float, float, float]:
        """Touch (s), clock error (ppm), gain and offset of a channel."""
        c = self.channels[index]
        shift, ppm, gain, offset = (float(x[i]) for i in self.places[index][:4])
        return c.touch_s + shift * SHIFT_UNIT_S, ppm, gain, offset * c.peak

    def phase(self, x: np.ndarray, index: int) -> float:
        """Phase of a channel under a law, in steps; of another channel it means nothing."""
        place = self.places[index]
        return float(x[place[4]]) if len(place) > 4 else 0.5

    def predicted(
        self, x: np.ndarray, index: int, until_s: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What channel `index` should read, without gain and offset; its slope by time, 1/s; and
        the times after the touch, s; (samples,) each."""
        touch_s, ppm, _, _ = self.nuisances(x, index)
        tau = self.channels[index].after_touch_s(touch_s, ppm)
        seen = self.observed(index, self.values(x), until_s, self.phase(x, index))
        inside = tau <= until_s
        value, slope = np.zeros(len(tau)), np.zeros(len(tau))
        value[inside], slope[inside] = seen.value(tau[inside]), seen.slope(tau[inside])
        return value, slope, tau

    def point(
        self, x: np.ndarray, until_s: float, early: bool, jacobian: bool = True,
        exact: bool = False,
    ) -> Point:  # fmt: skip
        """Residuals and their derivatives with the samples up to `until_s` after the touch.

        Args:
            x: parameters.
            until_s: end of the window, s.
            early: whether weak priors hold the keys near their start.
            jacobian: whether derivatives are wanted.
            exact: whether the model is taken as exact.

        Raises:
            SceneError: a value that the scene refuses.
        """
        n = len(x)
        parts, columns, rows, at = [], [], [], 0
        of_errors, by_errors = [], []
        for index, c in enumerate(self.channels):
            _, _, gain, offset = self.nuisances(x, index)
            value, slope, tau = self.predicted(x, index, until_s)
            good = c.counted(tau <= until_s)
            raw = np.where(c.kept & (tau <= until_s), gain * value + offset - c.value, 0.0)
            white = c.whitened(raw)[good]
            error = None if exact or c.discrepancy is None else c.discrepancy.on(good)
            if error is not None:
                white, own = error.applied(white)
                of_errors.append(own)
            parts.append(white)
            rows.append(slice(at, at + len(white)))
            at += len(white)
            if not jacobian:
                continue
            block = self.derivatives(x, index, until_s, (value, slope, tau))
            block[~(c.kept & (tau <= until_s))] = 0.0
            white = c.whitened(block)[good]
            if error is not None:
                white, own = error.applied(white)
                by_errors.append(own)
            columns.append(white)
        prior, by = self._priors(x, early)
        residual = np.concatenate([*parts, *of_errors, prior])
        return Point(
            x, residual,
            np.concatenate([*columns, *by_errors, by]) if jacobian else np.empty((0, n)), rows,
            slice(len(residual) - len(prior), len(residual)),
        )  # fmt: skip

    def derivatives(
        self, x: np.ndarray, index: int, until_s: float,
        predicted: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> np.ndarray:  # fmt: skip
        """Derivatives of a channel's readings by all parameters, (samples, parameters).

        `predicted`: of the same point.
        """
        value, slope, tau = predicted
        _, ppm, gain, _ = self.nuisances(x, index)
        block = np.zeros((len(tau), len(x)))
        for j, f in enumerate(self.moving):
            if not own_values({f.key: f.start}, self.channels[index].record):
                continue
            bounds = math.log(f.low), math.log(f.high)
            step = self._difference(index)
            block[:, j] = gain * self._by(x, index, until_s, j, step, bounds, tau)
        place = self.places[index]
        stretch = 1.0 + 1e-6 * ppm
        block[:, place[0]] = -gain * slope * SHIFT_UNIT_S / stretch
        block[:, place[1]] = -gain * slope * tau * 1e-6 / stretch
        block[:, place[2]] = value
        block[:, place[3]] = self.channels[index].peak
        for at in () if self.phases_held else place[4:]:
            step = _DIFFERENCE_PHASE * self.phases[at]
            anywhere = -math.inf, math.inf
            block[:, at] = gain * self._by(x, index, until_s, at, step, anywhere, tau)
        return block

    def _difference(self, index: int) -> float:
        model = self.models[index]
        if not isinstance(model, LoopModel):
            return _DIFFERENCE
        return _DIFFERENCE_ROUNDED if model.converts else _DIFFERENCE_LOOP

    def _by(
        self, x: np.ndarray, index: int, until_s: float, j: int, step: float,
        bounds: tuple[float, float], tau: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """Derivative by parameter `j`: central difference, one-sided at a bound, and where the law
        decides otherwise on one side."""
        up, down = x.copy(), x.copy()
        up[j] = min(x[j] + step, bounds[1])
        down[j] = max(x[j] - step, bounds[0])
        inside = tau <= until_s
        found = np.zeros(len(tau))

        def seen(at: np.ndarray) -> np.ndarray:
            phase = self.phase(at, index)
            return self.observed(index, self.values(at), until_s, phase).value(tau[inside])

        one, other = seen(up), seen(down)
        found[inside] = (one - other) / (up[j] - down[j])
        if isinstance(self.models[index], LoopModel) and up[j] > x[j] > down[j]:
            middle = seen(x)
            sides = (one - middle) / (up[j] - x[j]), (middle - other) / (x[j] - down[j])
            sizes = [float(side @ side) for side in sides]
            if max(sizes) > _JUMP**2 * min(sizes):
                found[inside] = sides[int(np.argmin(sizes))]
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
        shared: set[int] = set()
        for c, place in zip(self.channels, self.places, strict=True):
            gain_sd, clock_sd = c.prior_sds(exact=True)
            if place[1] not in shared:
                row(place[1], 0.0, clock_sd)
            if place[2] not in shared:
                row(place[2], 1.0, gain_sd)
            shared |= {*place[1:3]}
        for at, period in self.phases.items():
            # All phases are as likely, so nothing is pulled; but none is more than a period off.
            row(at, float(x[at]), _PHASE_SD * period)
        return np.array(rows), np.array(by).reshape(-1, n)

    def pulls(self, x: np.ndarray) -> dict[str, float]:
        """How far each prior is pulled, in standard deviations, by name."""
        found = {}
        for j, f in enumerate(self.moving):
            if f.prior is not None:
                found[f.key] = (float(x[j]) - math.log(f.start)) / f.prior
        for index, c in enumerate(self.channels):
            _, ppm, gain, _ = self.nuisances(x, index)
            gain_sd, clock_sd = c.prior_sds()
            found[f"{c.record.name}: clock_ppm"] = ppm / clock_sd
            found[f"{c.record.name}: gain"] = (gain - 1.0) / gain_sd
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
    """A step that changes no key by more than a third, and no phase by more than a tenth of its
    period: beyond, derivatives mean little."""
    for at, period in problem.phases.items():
        of_phase = places == at
        move[of_phase] = np.clip(move[of_phase], -_MOST_PHASE * period, _MOST_PHASE * period)
    keys = places < len(problem.moving)
    most = float(np.max(np.abs(move[keys]), initial=0.0))
    return move * (0.3 / most) if most > 0.3 else move


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
        contact = (tau > -0.5 * problem.models[index].contact_s) & (
            tau < 1.5 * problem.models[index].contact_s
        )
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
            rejected += len(single)
    return rejected
