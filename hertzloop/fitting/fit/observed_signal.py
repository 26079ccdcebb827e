"""What a measuring chain makes of a quantity: filters on a fine grid, then the sample times."""

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import scipy

from hertzloop.fitting.fit.simulated_impact import SimulatedImpact
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.quantities import QUANTITIES
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup
from hertzloop.sensors.acquisition import Filters, SensorSpec

_REACH = 12.0  # periods of the corner that a brick wall reaches on both sides
_FINER, _MOST_REFINED = 4, 30_000  # points of the filters' grid for a step; of at most so many


@dataclass(frozen=True)
class MeasuringChain(Filters):
    """Filters of a measuring chain, which may end with the brick wall of a sigma-delta converter:
    `low_pass` is one of those of `records.measurement`."""

    def filtered(self, value: np.ndarray, step_s: float) -> np.ndarray:
        """Filter samples that are zero before the first one.

        Every filter is exact for an input that is linear between samples.

        Args:
            value: input, shape (steps,).
            step_s: distance of the samples, s.

        Returns:
            Output, shape (steps,).
        """
        for own_00, own_01, own_10, own_11, ramp_0, ramp_1, low in self.sections(step_s):
            rise = np.diff(value, prepend=0.0)
            off = scipy.signal.lfilter(
                [ramp_0, own_01 * ramp_1 - own_11 * ramp_0],
                [1.0, -own_00 - own_11, own_00 * own_11 - own_01 * own_10],
                rise,
            )
            value = value + off if low else -off
        if self.low_pass_hz is not None and self.before_s:
            # The brick wall of a sigma-delta converter: a symmetric sinc in a Blackman window.
            reach = round(self.before_s / step_s)
            taps = np.sinc(2.0 * self.low_pass_hz * step_s * np.arange(-reach, reach + 1))
            taps *= np.blackman(len(taps))
            padded = np.pad(value, reach, mode="edge")
            filtered = scipy.signal.fftconvolve(padded, taps / np.sum(taps), mode="valid")
            return np.asarray(filtered)
        return value

    @property
    def before_s(self) -> float:
        """How long before its input the output begins, s: zero of causal filters."""
        if self.low_pass_hz is None or self.low_pass != "sigma-delta":
            return 0.0
        return _REACH / self.low_pass_hz

    def low_pass_poles(self) -> tuple[complex, ...]:
        """Poles of the low-pass, 1/s: none of a brick wall."""
        return () if self.before_s else super().low_pass_poles()


def chain_of_record(record: Record, setup: Setup) -> MeasuringChain:
    """Return the chain of a record: that of its table, else that of the scene's sensor where this
    samples the same quantity."""
    filters: Measurement | SensorSpec
    if record.measurement.filtered:
        filters = record.measurement
    elif QUANTITIES[record.quantity].sensed == setup.scene.sensors.quantity:
        filters = setup.sensor
    else:
        return MeasuringChain()
    return MeasuringChain(*(getattr(filters, one.name) for one in fields(Filters)))


@dataclass(frozen=True)
class ObservedSignal:
    """A filtered quantity as a function of the time after the first touch."""

    simulated: SimulatedImpact
    quantity: str
    chain: MeasuringChain
    away_from_contact: bool
    spline: Any  # of the output over the fine grid

    def value(self, time_s: np.ndarray) -> np.ndarray:
        """Values at times after the touch, s; shape as `time_s`."""
        if self.chain.ideal:
            return self.simulated.value(self.quantity, time_s, self.away_from_contact)
        return self._of_spline(time_s, 0)

    def slope(self, time_s: np.ndarray) -> np.ndarray:
        """Derivative by time; shape as `time_s`."""
        if self.quantity in ("xi", "xi_s") and self.chain.ideal:
            h = 0.1 * self.simulated.step_s
            return (self.value(time_s + h) - self.value(time_s - h)) / (2.0 * h)
        return self._of_spline(time_s, 1)

    def _of_spline(self, time_s: np.ndarray, order: int) -> np.ndarray:
        grid = self.spline.x
        found = self.spline(np.clip(time_s, grid[0], grid[-1]), order)
        return np.asarray(np.where(time_s > grid[0], found, 0.0))


def observe(
    simulated: SimulatedImpact, quantity: str, chain: MeasuringChain, away_from_contact: bool
) -> ObservedSignal:
    """Return what a chain shows of a simulated drop."""
    grid_s = simulated.time_s
    if chain.before_s:
        more = math.ceil(chain.before_s / simulated.step_s)
        grid_s = grid_s[0] + np.arange(-more, len(grid_s)) * simulated.step_s
    if not chain.ideal and len(grid_s) <= _MOST_REFINED:
        # A filter is exact for straight lines between samples; a finer grid bends these less.
        n = _FINER * (len(grid_s) - 1) + 1
        grid_s = grid_s[0] + np.arange(n) * (simulated.step_s / _FINER)
    fine = simulated.value(quantity, grid_s, away_from_contact)
    if not chain.ideal:
        fine = chain.filtered(fine, float(grid_s[1] - grid_s[0]))
    spline = scipy.interpolate.CubicSpline(grid_s, fine)
    return ObservedSignal(simulated, quantity, chain, away_from_contact, spline)
