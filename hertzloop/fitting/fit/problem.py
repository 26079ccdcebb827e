"""The least-squares problem of a fit: predictions, residuals, and their derivatives."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np

from hertzloop.fitting.fit.free_keys import is_chain_key, values_for_record
from hertzloop.fitting.fit.parameters import SHIFT_UNIT_S, FitParameters, prior_rows
from hertzloop.fitting.fit.simulated_impact import MeasuringChain, ObservedSignal, observe

_STEPS_OF_STAGE = 4  # expected steps of a minimisation
_JUMP = 4.0  # ratio of the derivatives on both sides from which the law decides otherwise on one
_PHASE_STEP = 0.04  # of a derivative by a phase, in periods
_FIRST_WINDOW = 1.5  # end of the first window, contact times
_GROWTH = 3.0  # end of a window over that of the one before
_LAST_WINDOW = 0.6  # from this share of the longest record on, a window is the whole record


@dataclass
class SimulationCounter:
    """Simulations of a fit, with all of its problems.

    Attributes:
        on_progress: is called with the simulations done and expected after each one.
        done: number of simulations so far.
        expected: number of simulations of the whole fit.
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


def derivative(
    readings: Callable[[np.ndarray], np.ndarray],
    x: np.ndarray,
    j: int,
    step: float,
    bounds: tuple[float, float],
    looped: bool,
) -> np.ndarray:
    """Return the derivative of readings, (samples,): a central difference, one-sided at a bound.

    Args:
        readings: as a function of the parameters.
        x: parameters.
        j: number of the parameter.
        step: of the parameter.
        bounds: of the parameter.
        looped: whether a law may decide otherwise on one side; then the other side is used.
    """
    up, down = x.copy(), x.copy()
    up[j] = min(x[j] + step, bounds[1])
    down[j] = max(x[j] - step, bounds[0])
    one, other = readings(up), readings(down)
    if looped and up[j] > x[j] > down[j]:
        middle = readings(x)
        sides = (one - middle) / (up[j] - x[j]), (middle - other) / (x[j] - down[j])
        sizes = [float(side @ side) for side in sides]
        if max(sizes) > _JUMP**2 * min(sizes):
            return sides[int(np.argmin(sizes))]
    return np.asarray((one - other) / (up[j] - down[j]))


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


class ChannelIterate(NamedTuple):
    """A channel at an iterate.

    Attributes:
        predicted: what it should read.
        counted: which of its samples count, (samples,).
        rows: where these stand in the residual.
    """

    predicted: Prediction
    counted: np.ndarray
    rows: slice


@dataclass
class Iterate:
    """Parameters of a fit with their residuals.

    Attributes:
        x: logarithms of the keys, then nuisances, (parameters,).
        until_s: end of the window after the touch, s.
        residual: whitened rows of all channels, rows of the discrepancies, and rows of the priors,
            (rows,).
        jacobian: derivatives of the residual, (rows, parameters).
        channels: of the fit.
        prior_rows: rows of the priors.
    """

    x: np.ndarray
    until_s: float
    residual: np.ndarray
    jacobian: np.ndarray
    channels: list[ChannelIterate]
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

    def covariance(self) -> np.ndarray:
        """Return the covariance of all parameters, (parameters, parameters)."""
        inverse = self.pseudo_inverse()
        return np.asarray(inverse @ inverse.T)


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
        window: Sequence[np.ndarray] | None = None,
    ) -> Iterate:
        """Return residuals and derivatives with the samples up to `until_s` after the touch.

        Args:
            x: parameters.
            until_s: end of the window, s.
            early: whether weak priors hold the keys near their start.
            jacobian: whether derivatives are wanted.
            exact: whether the model is taken as exact.
            window: which samples of each channel count; by default those up to `until_s`.

        Raises:
            SceneError: a value that the scene refuses.
        """
        inside = self.samples_until(x, until_s) if window is None else window
        parts, columns, channels, at = [], [], [], 0
        of_discrepancies, by_discrepancies = [], []
        for index, c in enumerate(self.channels):
            predicted = self._predict(x, index, until_s, inside[index])
            used = c.kept & inside[index]
            counted = c.counted(inside[index])
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
            block = self._derivatives(x, index, until_s, predicted, inside[index])
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

    def samples_until(self, x: np.ndarray, until_s: float) -> list[np.ndarray]:
        """Return which samples of each channel are up to `until_s` after the touch, (samples,)."""
        return [
            c.after_touch_s(*self.nuisances(x, index)[:2]) <= until_s
            for index, c in enumerate(self.channels)
        ]

    def _predict(self, x: np.ndarray, index: int, until_s: float, inside: np.ndarray) -> Prediction:
        """Return what channel `index` should read at the samples `inside` a window; zero beyond."""
        touch_s, ppm, gain, offset = self.nuisances(x, index)
        tau = self.channels[index].after_touch_s(touch_s, ppm)
        seen = self.simulate_channel(index, self.key_values(x), until_s, self.phase(x, index))
        value, slope = np.zeros(len(tau)), np.zeros(len(tau))
        value[inside], slope[inside] = seen.value(tau[inside]), seen.slope(tau[inside])
        return Prediction(value, slope, tau, gain * value + offset)

    def _derivatives(
        self,
        x: np.ndarray,
        index: int,
        until_s: float,
        predicted: Prediction,
        inside: np.ndarray,
    ) -> np.ndarray:
        """Return the derivatives of a channel's readings, (samples, parameters)."""
        value, slope, tau, _ = predicted
        _, ppm, gain, _ = self.nuisances(x, index)
        channel, simulator = self.channels[index], self.simulators[index]

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
