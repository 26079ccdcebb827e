"""What the measuring chain makes of a quantity: filters on the fine grid, then the sample times."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from hertzloop.setup import Setup
from hertzloop.studies.fit.model import Simulated
from hertzloop.studies.fit.records import QUANTITIES, Record

_REACH = 12.0  # periods of the corner that a brick wall reaches on both sides
_FINER, _MOST_REFINED = 4, 30_000  # points of the filters' grid for a step; of at most so many


@dataclass(frozen=True)
class Chain:
    """Filters of a measuring chain, in their order; None is no filter.

    `resonance_hz`, `resonance_damping`: second-order response of the sensor, of a force cell for
    example. `ac_coupling_hz`: first-order high-pass. `low_pass_hz`: where the low-pass is 3 dB
    down; `low_pass`: its kind, of `records.LOW_PASSES`; `low_pass_order`: of the two causal kinds.
    """

    resonance_hz: float | None = None
    resonance_damping: float = 0.02
    ac_coupling_hz: float | None = None
    low_pass_hz: float | None = None
    low_pass: str = "butterworth"
    low_pass_order: int = 1

    @property
    def ideal(self) -> bool:
        """Whether there is no filter at all."""
        return (
            self.resonance_hz is None and self.ac_coupling_hz is None and (self.low_pass_hz is None)
        )

    def filtered(self, value: np.ndarray, step_s: float) -> np.ndarray:
        """Filter samples that are zero before the first one.

        Every filter is exact for an input that is linear between samples.

        Args:
            value: input, shape (steps,).
            step_s: distance of the samples, s.

        Returns:
            Output, shape (steps,).
        """
        if self.resonance_hz is not None:
            omega = 2.0 * math.pi * self.resonance_hz
            value = _resonant(omega, self.resonance_damping, value, step_s)
        if self.ac_coupling_hz is not None:
            omega = 2.0 * math.pi * self.ac_coupling_hz
            one = np.array([[-omega]]), np.array([omega]), np.array([-1.0])
            value = _through(*one, 1.0, value, step_s)
        if self.low_pass_hz is None:
            return value
        if self.before_s:
            # The brick wall of a sigma-delta converter: a symmetric sinc in a Blackman window.
            reach = round(self.before_s / step_s)
            taps = np.sinc(2.0 * self.low_pass_hz * step_s * np.arange(-reach, reach + 1))
            taps *= np.blackman(len(taps))
            padded = np.pad(value, reach, mode="edge")
            filtered = scipy.signal.fftconvolve(padded, taps / np.sum(taps), mode="valid")
            return np.asarray(filtered)
        for pole in self._poles():
            if pole.imag > 1e-9 * abs(pole):
                value = _resonant(abs(pole), -pole.real / abs(pole), value, step_s)
            elif pole.imag >= -1e-9 * abs(pole):
                one = np.array([[-abs(pole)]]), np.array([abs(pole)]), np.array([1.0])
                value = _through(*one, 0.0, value, step_s)
        return value

    @property
    def before_s(self) -> float:
        """How long before its input the output begins, s: zero of causal filters."""
        if self.low_pass_hz is None or self.low_pass != "sigma-delta":
            return 0.0
        return _REACH / self.low_pass_hz

    def _poles(self) -> list[complex]:
        """Poles of the causal low-pass, 1/s."""
        assert self.low_pass_hz is not None
        omega = 2.0 * math.pi * self.low_pass_hz
        if self.low_pass_order == 1:
            return [complex(-omega)]
        if self.low_pass == "bessel":
            poles = scipy.signal.bessel(
                self.low_pass_order, omega, analog=True, output="zpk", norm="mag"
            )[1]
        else:
            poles = scipy.signal.butter(self.low_pass_order, omega, analog=True, output="zpk")[1]
        return [complex(pole) for pole in poles]


def _resonant(omega: float, damping: float, value: np.ndarray, step_s: float) -> np.ndarray:
    """Output of a second-order low-pass of unit static gain."""
    return _through(
        np.array([[0.0, 1.0], [-omega * omega, -2.0 * damping * omega]]),
        np.array([0.0, omega * omega]), np.array([1.0, 0.0]), 0.0, value, step_s,
    )  # fmt: skip


def _through(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, d: float, value: np.ndarray, step_s: float
) -> np.ndarray:
    """Output c x + d u of x' = a x + b u for an input that is linear over every step."""
    n = len(b)
    big = np.zeros((n + 2, n + 2))
    big[:n, :n], big[:n, n], big[n, n + 1] = a * step_s, b * step_s, 1.0
    turned = scipy.linalg.expm(big)
    phi, constant, ramp = turned[:n, :n], turned[:n, n], turned[:n, n + 1]
    # x[k+1] = phi x[k] + (constant - ramp) u[k] + ramp u[k+1], as a transfer function.
    poles = np.poly(phi)
    # Evaluate c (z - phi)^-1 (constant - ramp + ramp z) + d at n + 1 points of the unit circle.
    z = np.exp(2j * np.pi * np.arange(n + 1) / (n + 1)) * 1.5
    at = np.array([
        c @ np.linalg.solve(zi * np.eye(n) - phi, constant - ramp + ramp * zi) + d for zi in z
    ])  # fmt: skip
    numerator = np.linalg.solve(np.vander(z, n + 1), at * np.polyval(poles, z))
    return np.asarray(scipy.signal.lfilter(numerator.real, poles.real, value))


def chain_of(record: Record, setup: Setup) -> Chain:
    """Return the chain of a record: that of its table, else that of the scene's sensor where this
    samples the same quantity."""
    m = record.measured
    if m.filtered:
        return Chain(
            m.resonance_hz, m.resonance_damping, m.ac_coupling_hz, m.low_pass_hz, m.low_pass,
            m.low_pass_order,
        )  # fmt: skip
    if QUANTITIES[record.quantity].sensed != setup.quantity:
        return Chain()
    spec = setup.sensor
    return Chain(spec.resonance_hz, spec.resonance_damping, spec.ac_coupling_hz, spec.low_pass_hz)


@dataclass(frozen=True)
class Observed:
    """A filtered quantity as a function of the time after the first touch."""

    simulated: Simulated
    quantity: str
    chain: Chain
    elsewhere: bool
    spline: Any  # of the output over the fine grid

    def value(self, time_s: np.ndarray) -> np.ndarray:
        """Values at times after the touch, s; shape as `time_s`."""
        if self.chain.ideal:
            return self.simulated.value(self.quantity, time_s, self.elsewhere)
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


def observe(simulated: Simulated, quantity: str, chain: Chain, elsewhere: bool) -> Observed:
    """Return what a chain shows of a simulated drop."""
    grid_s = simulated.time_s
    if chain.before_s:
        more = math.ceil(chain.before_s / simulated.step_s)
        grid_s = grid_s[0] + np.arange(-more, len(grid_s)) * simulated.step_s
    if not chain.ideal and len(grid_s) <= _MOST_REFINED:
        # A filter is exact for straight lines between samples; a finer grid bends these less.
        n = _FINER * (len(grid_s) - 1) + 1
        grid_s = grid_s[0] + np.arange(n) * (simulated.step_s / _FINER)
    fine = simulated.value(quantity, grid_s, elsewhere)
    if not chain.ideal:
        fine = chain.filtered(fine, float(grid_s[1] - grid_s[0]))
    spline = scipy.interpolate.CubicSpline(grid_s, fine)
    return Observed(simulated, quantity, chain, elsewhere, spline)
