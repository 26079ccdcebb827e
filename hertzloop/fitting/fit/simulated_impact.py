"""A simulated impact, and what an ideal sensor would see of it."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from hertzloop.plant import time_series as ts
from hertzloop.plant.contact.hertz import Contact
from hertzloop.plant.contact.yielding import above_dent_m, elastic_n

_RATE_S = 2e-9  # for the rate of the force
_AT_NODE = 1e-6  # of a step: so near, a time is that of a jump


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
