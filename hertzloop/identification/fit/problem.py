"""The least-squares problem of a fit: residuals, and derivatives by keys and nuisances."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from hertzloop.identification.fit.channel import Channel
from hertzloop.identification.fit.control_keys import is_control_key
from hertzloop.identification.fit.free_keys import FreeKey
from hertzloop.identification.fit.loop_model import LoopModel
from hertzloop.identification.fit.model import FrozenModel
from hertzloop.identification.fit.observation import MeasuringChain, ObservedSignal, observe
from hertzloop.identification.records.chain_keys import is_chain_key
from hertzloop.identification.records.record import Record

_DIFFERENCE = 1e-4  # of a key, for central differences
# Under a law; with converters, which round what it reads and commands; of a phase, in periods.
_DIFFERENCE_LOOP, _DIFFERENCE_ROUNDED, _DIFFERENCE_PHASE = 2e-3, 3e-2, 0.04
_JUMP = 4.0  # times as large a derivative on one side: the law decides otherwise there
_PHASE_SD = math.sqrt(1.0 / 12.0)  # of a phase that is uniform over a period
_FIRST_WINDOW, _GROWTH = 1.5, 3.0  # contacts; from window to window
_STEPS_OF_STAGE = 4  # of a minimisation, as expected
SHIFT_UNIT_S = 1e-6  # s


@dataclass
class SimulationCounter:
    """Counts the simulations of a fit, with all of its problems: those done and those expected.

    `on_progress` is called with both after each simulation.
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
        """Expect a number of further minimisations of a problem with some keys."""
        self.expected = self.done + _STEPS_OF_STAGE * stages * (2 * keys + 2)


@dataclass
class Iterate:
    """Parameters of a fit with their residuals.

    Attributes:
        x: logarithms of the keys, then nuisances, (parameters,).
        residual: whitened rows of all channels, rows of the model's errors, and rows of the
            priors, (rows,).
        jacobian: derivatives of the residual, (rows, parameters).
        channel_rows: rows of each channel.
        prior_rows: rows of the priors.
    """

    x: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    channel_rows: list[slice]
    prior_rows: slice

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals, priors included."""
        return float(self.residual @ self.residual)

    def pseudo_inverse(self, least: float = 1e-15) -> np.ndarray:
        """Pseudo-inverse of the Jacobian with columns of length one, scaled back; shape
        (parameters, rows). `least`: singular value that counts, over the largest."""
        length = np.sqrt(np.sum(self.jacobian**2, axis=0))
        length[length == 0.0] = 1.0
        return np.linalg.pinv(self.jacobian / length, rcond=least) / length[:, np.newaxis]


class Prediction(NamedTuple):
    """What a channel should read, (samples,) each: values without gain and offset, their slope by
    time, 1/s, and the times after the touch, s."""

    value: np.ndarray
    slope: np.ndarray
    tau: np.ndarray


class NuisanceIndices(NamedTuple):
    """Places of the nuisances of a channel among the parameters; `phase`: None without a law."""

    shift: int
    clock: int
    gain: int
    offset: int
    phase: int | None = None

    @property
    def all(self) -> list[int]:
        """Those that the channel has."""
        return [index for index in self if index is not None]


@dataclass
class FitProblem:
    """Keys, channels and models of a fit.

    Attributes:
        free: the free keys.
        channels: the records, made ready.
        models: frozen model of each channel; channels of one setup share one.
        chains: measuring chain of each channel at the start; a free key of the sensor changes it.
        fixed: keys that are held at a value.
        evaluations: number of simulations so far.
        phases_held: whether the phases stay as they are.
        tally: simulations of the whole fit that the problem is a part of.
    """

    free: Sequence[FreeKey]
    channels: Sequence[Channel]
    models: Sequence[FrozenModel]
    chains: Sequence[MeasuringChain]
    fixed: dict[str, float] = field(default_factory=dict)
    evaluations: int = 0
    phases_held: bool = False
    tally: SimulationCounter = field(default_factory=SimulationCounter)

    @property
    def varied_keys(self) -> list[FreeKey]:
        """The free keys that are not held at a value."""
        return [f for f in self.free if f.key not in self.fixed]

    @property
    def whole_step_key(self) -> FreeKey | None:
        """The free key in whole steps, if there is one; it is held at a value all the time."""
        return next((f for f in self.free if f.resolution is not None), None)

    @property
    def looped(self) -> bool:
        """Whether a record was taken under a law."""
        return any(isinstance(model, LoopModel) for model in self.models)

    @property
    def erring(self) -> bool:
        """Whether the model has an error in a record."""
        return any(c.discrepancy is not None for c in self.channels)

    @property
    def nuisance_indices(self) -> list[NuisanceIndices]:
        """Places of the nuisances of every channel. Channels of one clock share shift, clock and
        phase; hits share the clock, and the gain of each sensor."""
        known: dict[tuple[str, object], int] = {}
        found: list[NuisanceIndices] = []
        for index, (c, model) in enumerate(zip(self.channels, self.models, strict=True)):
            record, hit = c.record, c.record.hit > 0
            clock = record.measurement.clock or index
            sensor = repr(replace(record.measurement, clock=None, set={})) if hit else index
            of = {
                "shift": clock,
                "clock": "of hits" if hit else clock,
                "gain": sensor,
                "offset": index,
            }
            of |= {"phase": clock} if isinstance(model, LoopModel) else {}
            keys = len(self.varied_keys)
            at = [known.setdefault(one, keys + len(known)) for one in of.items()]
            found.append(NuisanceIndices(*at))
        return found

    @property
    def phase_periods(self) -> dict[int, int]:
        """Where the phases stand, and the period of each in steps."""
        return {
            at.phase: model.period
            for at, model in zip(self.nuisance_indices, self.models, strict=True)
            if isinstance(model, LoopModel) and at.phase is not None
        }

    def key_values(self, x: np.ndarray) -> dict[str, float]:
        """Return the scene keys at parameters `x`."""
        found = dict(self.fixed)
        for f, value in zip(self.varied_keys, x, strict=False):
            found[f.key] = float(np.clip(math.exp(value), f.low, f.high))
        return found

    def simulate_channel(
        self, index: int, values: dict[str, float], until_s: float, phase: float = 0.5
    ) -> ObservedSignal:
        """Return what the chain of channel `index` shows with these keys. Raises SceneError.

        Args:
            index: of the channel.
            values: scene keys.
            until_s: end of the simulation after the touch, s.
            phase: from the last sample to the touch, in steps; without effect without a law.
        """
        model, channel = self.models[index], self.channels[index]
        of_plant = values_for_record(values, channel.record)
        chain = self.chains[index]
        own: dict[str, Any] = {k.partition(".")[2]: v for k, v in values.items() if is_chain_key(k)}
        if own and channel.record.quantity:
            chain = MeasuringChain(**(vars(chain) | own))
        before = model.simulations
        if isinstance(model, LoopModel):
            simulated = model.run(of_plant, until_s, phase)
        else:
            alone = {k: v for k, v in of_plant.items() if not ignored_without_control(k)}
            simulated = model.run(alone, until_s)
        self.evaluations += model.simulations - before
        self.tally.add(model.simulations - before)
        return observe(simulated, channel.record.quantity, chain, model.away_from_contact)

    def start_vector(self) -> np.ndarray:
        """Return the starting parameters: logarithms of keys, then nuisances of every channel."""
        indices = self.nuisance_indices
        found = np.zeros(max((max(at.all) for at in indices), default=-1) + 1)
        found[: len(self.varied_keys)] = [math.log(f.start) for f in self.varied_keys]
        for c, at in zip(self.channels, indices, strict=True):
            found[[at.clock, at.gain, at.offset]] = c.ppm, c.gain, c.offset / c.peak
            if at.phase is not None:
                found[at.phase] = c.phase
        return found

    def nuisances(self, x: np.ndarray, index: int) -> tuple[float, float, float, float]:
        """Return touch (s), clock error (ppm), gain and offset of a channel."""
        c = self.channels[index]
        shift, ppm, gain, offset = (float(x[i]) for i in self.nuisance_indices[index][:4])
        return c.touch_s + shift * SHIFT_UNIT_S, ppm, gain, offset * c.peak

    def phase(self, x: np.ndarray, index: int) -> float:
        """Return the phase of a channel, in steps; without a law it has no effect."""
        at = self.nuisance_indices[index].phase
        return 0.5 if at is None else float(x[at])

    def predict(self, x: np.ndarray, index: int, until_s: float) -> Prediction:
        """Return what channel `index` should read, up to `until_s` after the touch; zero beyond."""
        touch_s, ppm, _, _ = self.nuisances(x, index)
        tau = self.channels[index].after_touch_s(touch_s, ppm)
        seen = self.simulate_channel(index, self.key_values(x), until_s, self.phase(x, index))
        inside = tau <= until_s
        value, slope = np.zeros(len(tau)), np.zeros(len(tau))
        value[inside], slope[inside] = seen.value(tau[inside]), seen.slope(tau[inside])
        return Prediction(value, slope, tau)

    def evaluate(
        self,
        x: np.ndarray,
        until_s: float,
        early: bool,
        jacobian: bool = True,
        exact: bool = False,
    ) -> Iterate:
        """Return residuals and derivatives with the samples up to `until_s` after the touch.

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
            predicted = self.predict(x, index, until_s)
            within = predicted.tau <= until_s
            good = c.counted(within)
            raw = np.where(c.kept & within, gain * predicted.value + offset - c.value, 0.0)
            white = c.whitened(raw)[good]
            error = None if exact or c.discrepancy is None else c.discrepancy.on_samples(good)
            if error is not None:
                white, own = error.split_rows(white)
                of_errors.append(own)
            parts.append(white)
            rows.append(slice(at, at + len(white)))
            at += len(white)
            if not jacobian:
                continue
            block = self.derivatives(x, index, until_s, predicted)
            block[~(c.kept & within)] = 0.0
            white = c.whitened(block)[good]
            if error is not None:
                white, own = error.split_rows(white)
                by_errors.append(own)
            columns.append(white)
        prior, by = self._prior_rows(x, early)
        residual = np.concatenate([*parts, *of_errors, prior])
        return Iterate(
            x,
            residual,
            np.concatenate([*columns, *by_errors, by]) if jacobian else np.empty((0, n)),
            rows,
            slice(len(residual) - len(prior), len(residual)),
        )

    def derivatives(
        self, x: np.ndarray, index: int, until_s: float, predicted: Prediction
    ) -> np.ndarray:
        """Return the derivatives of a channel's readings, (samples, parameters).

        Args:
            x: parameters.
            index: of the channel.
            until_s: end of the window after the touch, s.
            predicted: readings at the same parameters.
        """
        value, slope, tau = predicted
        _, ppm, gain, _ = self.nuisances(x, index)
        inside = tau <= until_s
        looped = isinstance(self.models[index], LoopModel)

        def readings(x: np.ndarray) -> np.ndarray:
            phase = self.phase(x, index)
            seen = self.simulate_channel(index, self.key_values(x), until_s, phase)
            return seen.value(tau[inside])

        block = np.zeros((len(tau), len(x)))
        for j, f in enumerate(self.varied_keys):
            if not values_for_record({f.key: f.start}, self.channels[index].record):
                continue
            bounds = math.log(f.low), math.log(f.high)
            step = _Step(j, self._difference(index), bounds, looped)
            block[inside, j] = gain * step.derivative(readings, x)
        at = self.nuisance_indices[index]
        stretch = 1.0 + 1e-6 * ppm
        block[:, at.shift] = -gain * slope * SHIFT_UNIT_S / stretch
        block[:, at.clock] = -gain * slope * tau * 1e-6 / stretch
        block[:, at.gain] = value
        block[:, at.offset] = self.channels[index].peak
        if at.phase is not None and not self.phases_held:
            size = _DIFFERENCE_PHASE * self.phase_periods[at.phase]
            step = _Step(at.phase, size, (-math.inf, math.inf), looped)
            block[inside, at.phase] = gain * step.derivative(readings, x)
        return block

    def _difference(self, index: int) -> float:
        """Step of a key's logarithm for derivatives of a channel."""
        model = self.models[index]
        if not isinstance(model, LoopModel):
            return _DIFFERENCE
        return _DIFFERENCE_ROUNDED if model.converts else _DIFFERENCE_LOOP

    def _prior_rows(self, x: np.ndarray, early: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return rows of the priors and their derivatives, (rows,) and (rows, parameters)."""
        rows, by, n = [], [], len(x)

        def row(place: int, centre: float, sd: float) -> None:
            rows.append((x[place] - centre) / sd)
            line = np.zeros(n)
            line[place] = 1.0 / sd
            by.append(line)

        for j, f in enumerate(self.varied_keys):
            if f.prior is not None:
                row(j, math.log(f.start), f.prior)
            elif early:
                row(j, math.log(f.start), f.early_sd)
        shared: set[int] = set()
        for c, at in zip(self.channels, self.nuisance_indices, strict=True):
            gain_sd, clock_sd = c.prior_sds(exact=True)
            if at.clock not in shared:
                row(at.clock, 0.0, clock_sd)
            if at.gain not in shared:
                row(at.gain, 1.0, gain_sd)
            shared |= {at.clock, at.gain}
        for phase, period in self.phase_periods.items():
            # All phases are as likely, so nothing is pulled; but none is more than a period off.
            row(phase, float(x[phase]), _PHASE_SD * period)
        return np.array(rows), np.array(by).reshape(-1, n)

    def prior_pulls(self, x: np.ndarray) -> dict[str, float]:
        """Return how far each prior is pulled, in standard deviations, by name."""
        found = {}
        for j, f in enumerate(self.varied_keys):
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


def values_for_record(values: Mapping[str, float], record: Record) -> dict[str, float]:
    """The scene keys of a record: without those of its table, which are not fitted in it, and of
    keys `KEY[HIT]` only those of its hit, as KEY."""
    found = {}
    for key, value in values.items():
        name, _, hit = key.partition("[")
        if name not in record.measurement.set and hit in ("", f"{record.hit}]"):
            found[name] = value
    return found


def ignored_without_control(key: str) -> bool:
    """Whether a drop without control does not depend on a key."""
    return is_chain_key(key) or is_control_key(key)


class _Step(NamedTuple):
    """A step for a derivative: number of the parameter, its size, the bounds of the parameter, and
    whether a law may decide otherwise on one side."""

    parameter: int
    size: float
    bounds: tuple[float, float]
    looped: bool

    def derivative(self, readings: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
        """Return the derivative of readings, (samples,): a central difference, one-sided at a bound
        and where the law decides otherwise on one side."""
        j = self.parameter
        up, down = x.copy(), x.copy()
        up[j] = min(x[j] + self.size, self.bounds[1])
        down[j] = max(x[j] - self.size, self.bounds[0])
        one, other = readings(up), readings(down)
        if self.looped and up[j] > x[j] > down[j]:
            middle = readings(x)
            sides = (one - middle) / (up[j] - x[j]), (middle - other) / (x[j] - down[j])
            sizes = [float(side @ side) for side in sides]
            if max(sizes) > _JUMP**2 * min(sizes):
                return sides[int(np.argmin(sizes))]
        return np.asarray((one - other) / (up[j] - down[j]))
