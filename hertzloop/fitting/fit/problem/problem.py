"""The least-squares problem of a fit: predictions, residuals, and their derivatives."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from hertzloop.fitting.fit.keys.key_scope import values_for_record
from hertzloop.fitting.fit.problem.iterate import ChannelIterate, Iterate, Prediction
from hertzloop.fitting.fit.problem.parameters import SHIFT_UNIT_S, FitParameters
from hertzloop.fitting.fit.problem.priors import prior_rows
from hertzloop.fitting.fit.simulation.finite_difference import derivative
from hertzloop.fitting.fit.simulation.measuring_chain import MeasuringChain
from hertzloop.fitting.fit.simulation.observed_signal import ObservedSignal, observe
from hertzloop.fitting.fit.simulation.simulation_counter import SimulationCounter
from hertzloop.fitting.records.chain_keys import is_chain_key

_PHASE_STEP = 0.04  # of a derivative by a phase, in periods
_FIRST_WINDOW = 1.5  # end of the first window, contact times
_GROWTH = 3.0  # end of a window over that of the one before
_LAST_WINDOW = 0.6  # from this share of the longest record on, a window is the whole record


@dataclass(kw_only=True)
class FitProblem(FitParameters):
    """Keys, channels and simulators of a fit.

    Attributes:
        chains: measuring chain of each channel at the start; a free key of the sensor changes it.
        phases_held: whether the phases stay as they are.
        counter: simulations of the whole fit that the problem is a part of.
    """

    chains: Sequence[MeasuringChain]
    phases_held: bool = False
    counter: SimulationCounter = field(default_factory=SimulationCounter)

    @property
    def looped(self) -> bool:
        """Whether a record was taken under a law."""
        return any(simulator.looped for simulator in self.simulators)

    @property
    def has_discrepancy(self) -> bool:
        """Whether the model has a discrepancy in a record."""
        return any(c.discrepancy is not None for c in self.channels)

    def hold(self, values: dict[str, float]) -> Self:
        """Return the problem with some more keys held at a value."""
        return replace(self, fixed=self.fixed | values)

    def of_channels(self, some: Sequence[int]) -> Self:
        """Return the problem of some channels; all its keys have to be held."""
        return replace(
            self,
            channels=[self.channels[i] for i in some],
            simulators=[self.simulators[i] for i in some],
            chains=[self.chains[i] for i in some],
        )

    @property
    def longest_s(self) -> float:
        """From the touch to the last sample of the longest record, s."""
        return max(c.duration_s for c in self.channels)

    def windows_s(self) -> list[float]:
        """Ends of the growing windows after the touch, s; the last is infinite but for rounding."""
        end = _FIRST_WINDOW * max(one.contact_s for one in self.simulators)
        found = []
        while end < _LAST_WINDOW * self.longest_s:
            found.append(end)
            end *= _GROWTH
        return [*found, 1.001 * self.longest_s + 2e-6]

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
        simulator, record = self.simulators[index], self.channels[index].record
        chain = self.chains[index]
        own: dict[str, Any] = {k.partition(".")[2]: v for k, v in values.items() if is_chain_key(k)}
        if own:
            chain = MeasuringChain(**(vars(chain) | own))
        before = simulator.simulations
        simulated = simulator.run(values_for_record(values, record), until_s, phase)
        self.counter.add(simulator.simulations - before)
        return observe(simulated, record.quantity, chain, simulator.away_from_contact)

    def evaluate(
        self,
        x: np.ndarray,
        until_s: float,
        early: bool = False,
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
        parts, columns, channels, at = [], [], [], 0
        of_discrepancies, by_discrepancies = [], []
        for index, c in enumerate(self.channels):
            predicted = self._predict(x, index, until_s)
            used = c.kept & (predicted.tau <= until_s)
            counted = c.counted(predicted.tau <= until_s)
            white = c.whitened(np.where(used, predicted.reading - c.value, 0.0))[counted]
            discrepancy = None if exact or not c.discrepancy else c.discrepancy.on_samples(counted)
            if discrepancy is not None:
                white, own = discrepancy.split_rows(white)
                of_discrepancies.append(own)
            parts.append(white)
            channels.append(ChannelIterate(predicted, counted, slice(at, at + len(white))))
            at += len(white)
            if not jacobian:
                continue
            block = self.derivatives(x, index, until_s, predicted)
            block[~used] = 0.0
            white = c.whitened(block)[counted]
            if discrepancy is not None:
                white, own = discrepancy.split_rows(white)
                by_discrepancies.append(own)
            columns.append(white)
        prior, by = prior_rows(self, x, early)
        residual = np.concatenate([*parts, *of_discrepancies, prior])
        return Iterate(
            x,
            until_s,
            residual,
            np.concatenate([*columns, *by_discrepancies, by])
            if jacobian
            else np.empty((0, len(x))),
            channels,
            slice(len(residual) - len(prior), len(residual)),
        )

    def _predict(self, x: np.ndarray, index: int, until_s: float) -> Prediction:
        """Return what channel `index` should read, up to `until_s` after the touch; zero beyond."""
        touch_s, ppm, gain, offset = self.nuisances(x, index)
        tau = self.channels[index].after_touch_s(touch_s, ppm)
        seen = self.simulate_channel(index, self.key_values(x), until_s, self.phase(x, index))
        inside = tau <= until_s
        value, slope = np.zeros(len(tau)), np.zeros(len(tau))
        value[inside], slope[inside] = seen.value(tau[inside]), seen.slope(tau[inside])
        return Prediction(value, slope, tau, gain * value + offset)

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
        channel, simulator = self.channels[index], self.simulators[index]
        inside = tau <= until_s

        def readings(x: np.ndarray) -> np.ndarray:
            phase = self.phase(x, index)
            return self.simulate_channel(index, self.key_values(x), until_s, phase).value(
                tau[inside]
            )

        block = np.zeros((len(tau), len(x)))
        for j, f in enumerate(self.varied_keys):
            if values_for_record({f.key: f.start}, channel.record):
                bounds = math.log(f.low), math.log(f.high)
                by_key = derivative(readings, x, j, simulator.key_step, bounds, simulator.looped)
                block[inside, j] = gain * by_key
        at = self.nuisance_indices[index]
        stretch = 1.0 + 1e-6 * ppm
        block[:, at.shift] = -gain * slope * SHIFT_UNIT_S / stretch
        block[:, at.clock] = -gain * slope * tau * 1e-6 / stretch
        block[:, at.gain] = value
        block[:, at.offset] = channel.peak
        if at.phase is not None and not self.phases_held:
            step, bounds = _PHASE_STEP * simulator.phase_period, (-math.inf, math.inf)
            block[inside, at.phase] = gain * derivative(readings, x, at.phase, step, bounds, True)
        return block
