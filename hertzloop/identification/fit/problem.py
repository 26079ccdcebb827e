"""The least-squares problem of a fit: residuals, and derivatives by keys and nuisances."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from hertzloop.identification.fit.channel import Channel
from hertzloop.identification.fit.difference import key_step, phase_step
from hertzloop.identification.fit.free_keys import FreeKey
from hertzloop.identification.fit.iterate import Iterate
from hertzloop.identification.fit.key_values import ignored_without_control, values_for_record
from hertzloop.identification.fit.loop_model import LoopModel
from hertzloop.identification.fit.model import FrozenModel
from hertzloop.identification.fit.observation import MeasuringChain, ObservedSignal, observe
from hertzloop.identification.fit.simulation_counter import SimulationCounter
from hertzloop.identification.records.chain_keys import is_chain_key

_PHASE_SD = math.sqrt(1.0 / 12.0)  # standard deviation of a phase, uniform over a period
_FIRST_WINDOW = 1.5  # end of the first window, contact times
_GROWTH = 3.0  # end of a window over that of the one before
_LAST_WINDOW = 0.6  # from this share of the longest record on, a window is the whole record
SHIFT_UNIT_S = 1e-6  # unit of a shift among the parameters, s


class Prediction(NamedTuple):
    """What a channel should read, (samples,) each.

    Attributes:
        value: without gain and offset, in the unit of the record.
        slope: derivative of the value by time, 1/s.
        tau: times after the touch, s.
        reading: with gain and offset.
    """

    value: np.ndarray
    slope: np.ndarray
    tau: np.ndarray
    reading: np.ndarray


class NuisanceIndices(NamedTuple):
    """Places of the nuisances of a channel among the parameters; no phase without a law."""

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
        phases_held: whether the phases stay as they are.
        counter: simulations of the whole fit that the problem is a part of.
    """

    free: Sequence[FreeKey]
    channels: Sequence[Channel]
    models: Sequence[FrozenModel]
    chains: Sequence[MeasuringChain]
    fixed: dict[str, float] = field(default_factory=dict)
    phases_held: bool = False
    counter: SimulationCounter = field(default_factory=SimulationCounter)

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
    def has_model_error(self) -> bool:
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
        self.counter.add(model.simulations - before)
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
        touch_s, ppm, gain, offset = self.nuisances(x, index)
        tau = self.channels[index].after_touch_s(touch_s, ppm)
        seen = self.simulate_channel(index, self.key_values(x), until_s, self.phase(x, index))
        inside = tau <= until_s
        value, slope = np.zeros(len(tau)), np.zeros(len(tau))
        value[inside], slope[inside] = seen.value(tau[inside]), seen.slope(tau[inside])
        return Prediction(value, slope, tau, gain * value + offset)

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
            predicted = self.predict(x, index, until_s)
            within = predicted.tau <= until_s
            good = c.counted(within)
            raw = np.where(c.kept & within, predicted.reading - c.value, 0.0)
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
        value, slope, tau, _ = predicted
        _, ppm, gain, _ = self.nuisances(x, index)
        inside = tau <= until_s

        def readings(x: np.ndarray) -> np.ndarray:
            phase = self.phase(x, index)
            seen = self.simulate_channel(index, self.key_values(x), until_s, phase)
            return seen.value(tau[inside])

        block = np.zeros((len(tau), len(x)))
        for j, f in enumerate(self.varied_keys):
            if not values_for_record({f.key: f.start}, self.channels[index].record):
                continue
            bounds = math.log(f.low), math.log(f.high)
            step = key_step(j, bounds, self.models[index])
            block[inside, j] = gain * step.derivative(readings, x)
        at = self.nuisance_indices[index]
        stretch = 1.0 + 1e-6 * ppm
        block[:, at.shift] = -gain * slope * SHIFT_UNIT_S / stretch
        block[:, at.clock] = -gain * slope * tau * 1e-6 / stretch
        block[:, at.gain] = value
        block[:, at.offset] = self.channels[index].peak
        if at.phase is not None and not self.phases_held:
            step = phase_step(at.phase, self.phase_periods[at.phase])
            block[inside, at.phase] = gain * step.derivative(readings, x)
        return block

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
        while end < _LAST_WINDOW * self.longest_s:
            found.append(end)
            end *= _GROWTH
        return [*found, 1.001 * self.longest_s + 2e-6]
