"""A simulated impact: what an ideal sensor would see of it, and what a measuring chain shows."""

import math
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.quantities import QUANTITIES
from hertzloop.fitting.records.record import Record
from hertzloop.plant import time_series as ts
from hertzloop.plant.contact.hertz import Contact
from hertzloop.plant.contact.yielding import above_dent_m, elastic_n
from hertzloop.scene.setup import Setup
from hertzloop.sensors.acquisition import Filters, SensorSpec

_RATE_S = 2e-9  # for the rate of the force
_AT_NODE = 1e-6  # of a step: so near, a time is that of a jump
_REACH = 12.0  # periods of the corner that a brick wall reaches on both sides
_FINER, _MOST_REFINED = 4, 30_000  # points of the filters' grid for a step; of at most so many


@dataclass(frozen=True)
class SimulatedImpact:
    """One simulated impact.

    Attributes:
        time_s: times after the first touch, s, (steps,).
        truth: time series of `hertzloop.plant.time_series.TRUTH`, (10, steps).
        contact: the contact.
        speed_m_s: impact speed.
        gravity_m_s2: acceleration of the striker in flight.
        mobility_m_ns: of a residual mode; zero without one.
        pushed_m_ns: the same where the actuator acts at the contact point, else zero.
        held: whether the actuator's force is constant over a step.
    """

    time_s: np.ndarray
    truth: np.ndarray
    contact: Contact
    speed_m_s: float
    gravity_m_s2: float
    mobility_m_ns: float = 0.0
    pushed_m_ns: float = 0.0
    held: bool = True
    _splines: dict[int, Any] = field(default_factory=dict, repr=False, compare=False)

    @property
    def step_s(self) -> float:
        """Length of a step, s."""
        return float(self.time_s[1] - self.time_s[0])

    def _spline(self, row: int) -> Any:
        if row not in self._splines:
            self._splines[row] = scipy.interpolate.CubicSpline(self.time_s, self.truth[row])
        return self._splines[row]

    @cached_property
    def _velocity(self) -> Any:
        """Velocity of the plate at the contact point, but for what follows the force at once.

        Behind a residual mode the velocity has a share Y F, as sharp as the force is where contact
        begins. The rest is smooth. Without a residual mode the velocity is the derivative of the
        displacement's spline, which is of fourth order at its knots.
        """
        if self.mobility_m_ns:
            at_once = self.mobility_m_ns * (self.truth[ts.F_C] - self.truth[ts.F_C1])
            if self.pushed_m_ns:  # the velocity of a row comes before a jump of the force
                pushed = self.truth[ts.F_A] + self.truth[ts.F_A1]
                at_once = at_once - self.pushed_m_ns * np.concatenate([[0.0], pushed[:-1]])
            return scipy.interpolate.CubicSpline(self.time_s, self.truth[ts.V_P] + at_once)
        moved = self._spline(ts.XI_P)
        return scipy.interpolate.CubicSpline(self.time_s, moved(self.time_s, 1))

    def _contact_velocity(self, time_s: np.ndarray, order: int = 0) -> np.ndarray:
        """Velocity of the plate at the contact point, or its derivative by time of order 1."""
        found = self._velocity(time_s, order)
        forces = (-self.mobility_m_ns, self.force_n), (self.pushed_m_ns, self.actuator_n)
        for mobility, force in forces:
            if mobility and order:
                rise = force(time_s + _RATE_S) - force(time_s - _RATE_S)
                found = found + mobility * rise / (2.0 * _RATE_S)
            elif mobility:
                found = found + mobility * force(time_s)
        return np.asarray(found)

    @cached_property
    def _measured_velocity(self) -> Any:
        """Velocity of the plate at the measuring point."""
        moved = self._spline(ts.XI_A)
        return scipy.interpolate.CubicSpline(self.time_s, moved(self.time_s, 1))

    def force_n(self, time_s: np.ndarray) -> np.ndarray:
        """Contact force at times after the touch (s, any shape): the contact law of the gap's
        spline. The rows hold means of a step, which are 5e-3 of the peak away from it."""
        time_s = np.clip(time_s, self.time_s[0], self.time_s[-1])
        gap = self._spline(ts.XI)(time_s)
        deepest = self._deepest(time_s, -gap)
        above = above_dent_m(self.contact, gap, deepest)
        found = elastic_n(self.contact, -gap, deepest)
        if self.contact.has_damper:
            rate = -self._spline(ts.XI)(time_s, 1)
            elastic = self.contact.stiffness * np.maximum(-gap, 0.0) ** 1.5
            damper = self.contact.viscous_n_s_m + self.contact.hunt_crossley_s_m * elastic
            found = found + damper * rate
        return np.asarray(np.where(above < 0.0, found, 0.0))

    @cached_property
    def _actuator(self) -> Any:
        """The smooth force of an actuator with a bandwidth: the derivative of its time integral,
        which the means of the steps give exactly."""
        impulse = np.concatenate([[0.0], np.cumsum(self.truth[ts.F_A])]) * self.step_s
        grid_s = self.time_s[0] + np.arange(len(impulse)) * self.step_s
        summed = scipy.interpolate.CubicSpline(grid_s, impulse)
        return scipy.interpolate.CubicSpline(grid_s, summed(grid_s, 1))

    def actuator_n(self, time_s: np.ndarray) -> np.ndarray:
        """Actuator force, up on the plate, at times after the touch (s, any shape); where it jumps,
        the middle of the jump."""
        time_s = np.clip(time_s, self.time_s[0], self.time_s[-1])
        if not self.held:
            return np.asarray(self._actuator(time_s))
        force, at = self.truth[ts.F_A], (time_s - self.time_s[0]) / self.step_s
        after = np.floor(at + _AT_NODE).astype(int)
        before = np.floor(at - _AT_NODE).astype(int)
        last = len(force) - 1
        return np.asarray(0.5 * (force[np.clip(before, 0, last)] + force[np.clip(after, 0, last)]))

    def _deepest(self, time_s: np.ndarray, penetration_m: np.ndarray) -> np.ndarray:
        if self.contact.limit is None:
            return np.maximum(penetration_m, 0.0)
        deepest = self.truth[ts.DEEPEST]
        row = np.clip(((time_s - self.time_s[0]) / self.step_s).astype(int), 0, len(deepest) - 1)
        after = deepest[np.minimum(row + 1, len(deepest) - 1)]
        return np.asarray(np.clip(penetration_m, deepest[row], np.maximum(after, deepest[row])))

    def value(
        self, quantity: str, time_s: np.ndarray, away_from_contact: bool = False
    ) -> np.ndarray:
        """Return a quantity at times after the first touch.

        Args:
            quantity: a key of `hertzloop.fitting.records.quantities.QUANTITIES`.
            time_s: s, shape (samples,); before the touch the plate is at rest.
            away_from_contact: at the measuring point instead of the contact point.

        Returns:
            Values in SI units, shape (samples,).
        """
        if quantity == "contact_force":
            return np.asarray(np.where(time_s > self.time_s[0], self.force_n(time_s), 0.0))
        if quantity == "actuator_force":
            return self.actuator_n(time_s)
        inside = np.clip(time_s, self.time_s[0], self.time_s[-1])
        if quantity in ("xi", "xi_s"):
            column = self._spline(ts.XI if quantity == "xi" else ts.XI_S)
            return np.asarray(np.where(time_s < 0.0, self._flight(time_s), column(inside)))
        if quantity == "xi_p":
            found = self._spline(ts.XI_A if away_from_contact else ts.XI_P)(inside)
        else:
            velocity = self._measured_velocity if away_from_contact else self._contact_velocity
            found = velocity(inside, {"v_p": 0, "acceleration": 1}[quantity])
        return np.asarray(np.where(time_s > self.time_s[0], found, 0.0))

    def _flight(self, time_s: np.ndarray) -> np.ndarray:
        """Height before the touch, at most that of the release, m."""
        g = self.gravity_m_s2
        before = np.minimum(-time_s, self.speed_m_s / g if g else math.inf)
        return np.asarray(before * (self.speed_m_s - 0.5 * g * before))


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
