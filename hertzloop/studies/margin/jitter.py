"""The jitter margin: how far the latency may vary while the loop stays stable.

A command that is late leaves an error of the force. In step r of a sampling interval of n steps, a
delay of at most D steps leaves out at most M_r = ceil((D - r)/n) changes of the command. By the
Cauchy-Schwarz inequality the error is at most M_r times as large as the changes, as the root of the
sum of squares over all samples. The stable loop answers it with changes
H_r = (1 - 1/Z) C G_r/(1 + L) of its command, where G_r is the response to a force in that step
alone. Give the error of step r the weight 1/M_r; the sum of M_r is D. By the small gain theorem the
loop stays stable if D times the largest sum of M_r |H_r|^2 on the unit circle is below 1. At n = 1
this is |L/(1 + L)| < 1/(D |Z - 1|), the condition of C.-Y. Kao and B. Lincoln, Automatica 40 (2004)
1429.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy

from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.flight import Margin
from hertzloop.studies.margin.gain import needle_angles
from hertzloop.studies.margin.identify import NotLinearError
from hertzloop.studies.margin.loop import PolyphaseLoop, loops_of
from hertzloop.studies.margin.table import Loop, SampledResponse, middle_of_cubic, refined

_HALVINGS, _POLISHES = 50, 4
_CLOSE = 0.05  # largest error of an interpolated log size
_FAR = 10.0  # log size below the largest one that cannot become it
_SAFE = 1e-6  # relative distance of a certified delay from the margin
_MOST_STEPS = 1 << 16  # beyond which a margin counts as without limit

Verdict = Literal["certified", "refuted", "undecided"]


@dataclass(frozen=True)
class JitterMargin:
    """How far the latency may vary above its shortest value.

    Attributes:
        margin_steps: largest additional latency, in whole steps, up to which every sequence of
            latencies keeps the loop stable; -1 if the loop is unstable at the shortest latency,
            None if that is undecided, and without limit up to 65 000 steps.
        margin_us: the same between two steps, us; -1 and None as above.
        frequency_hz: where the condition fails first, Hz; None without a stable loop.
        added_us: largest additional latency of the scene, by jitter, trace and drift, us.
        drops_out: whether commands drop out at random, without a longest burst.
        burst: most commands in a row that may drop out besides; -1 if not even none; None as above.
        verdict: "certified" if every sequence of latencies of the scene keeps the loop stable,
            "refuted" if a constant one of them does not, otherwise "undecided"; None if the latency
            does not vary.
        refuted_at_us: the constant latency of "refuted", us.
    """

    margin_steps: int | None
    margin_us: float | None
    frequency_hz: float | None
    added_us: float
    drops_out: bool
    burst: int | None
    verdict: Verdict | None
    refuted_at_us: float | None


def at_shortest_latency(setup: Setup) -> Setup:
    """Return a setup with its shortest latency throughout: no jitter, trace, drift or drop-outs."""
    path = setup.signal_path
    if not (path.varies or path.trace or path.drop_out_probability):
        return setup
    constant = {
        "controller.jitter_us": 0.0,
        "controller.drop_out_probability": 0.0,
        "controller.latency_trace": None,
        "controller.latency_trace_use": None,
        "controller.latency_us": path.latency_steps * setup.run.step_ns / 1e3,
    }
    if path.tick_steps:
        constant |= {"controller.clock_ppm": 0.0, "controller.clock_phase": 0.0}
    return setup.vary(constant)


def jitter_margin_of(setup: Setup, margin: Margin) -> JitterMargin | None:
    """Return the jitter margin of a setup; None without a linear loop.

    Args:
        setup: the run, with its jitter, trace, drift and drop-outs.
        margin: the margin of `at_shortest_latency(setup)`.

    Raises:
        SceneError: the scene is invalid.
    """
    loops = loops_of(at_shortest_latency(setup)) if margin.applicable else None
    if loops is None or isinstance(loops, NotLinearError):
        return None
    path, step_us, every = setup.signal_path, 1e6 * setup.run.step_s, setup.sensor.every_steps
    waits = math.floor(path.tick_steps + 0.5)  # at most, for a tick of the controller's clock
    added = path.jitter_steps + max(path.trace, default=0) + waits
    drops_out = path.drop_out_probability > 0.0
    latencies = path.latency_steps + np.arange(min(added, _MOST_STEPS) + 1)
    unstable = latencies[loops.unstable(latencies) > 0]
    steps, us, burst = (-1, -1.0, -1) if margin.stable is False else (None, None, None)
    hz, certified = None, False
    if margin.stable:
        delay, angle = ErrorResponse(loops, path.latency_steps).largest_delay()
        hz = angle / (2.0 * math.pi * every * setup.run.step_s)
        safe = math.floor(delay * (1.0 - _SAFE))
        certified = added <= safe and not drops_out
        if delay < _MOST_STEPS:
            steps, burst = safe, max(-1, (safe - added) // every)
            us = min(delay * step_us, _constant_us(margin))
    verdict: Verdict | None = None
    if added or drops_out:
        verdict = "refuted" if len(unstable) else "certified" if certified else "undecided"
    at_us = float(unstable[0]) * step_us if verdict == "refuted" else None
    return JitterMargin(steps, us, hz, added * step_us, drops_out, burst, verdict, at_us)


def _constant_us(margin: Margin) -> float:
    """Return how much constant latency keeps the loop stable, between two steps, us."""
    at_us = margin.latency_us or 0.0
    for first, last in margin.stable_windows_us or []:
        if first is not None and last is not None and first <= at_us <= last:
            return last - at_us
    return math.inf


class ErrorResponse:
    """How a stable loop answers errors of the force: log |H_r|^2 on the upper unit circle.

    Args:
        loops: the loop.
        latency: the shortest latency, steps, at which the loop is stable.
    """

    def __init__(self, loops: PolyphaseLoop, latency: int) -> None:
        n, first = len(loops.every), latency + loops.lead
        loop, self._delay = loops.at(latency)
        self._loop = loop
        self._steps = [Loop(loops.plant.in_step(n, (first + r) % n), loop.law) for r in range(n)]
        theta = needle_angles(loop, self._delay)[1:]  # the response is zero at Z = 1
        self._samples = refined(theta, self.at, _unsure)

    def at(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return log |H_r|^2 and its slope by the angle, shape (steps, points), at angles above 0
        and up to pi, shape (points,)."""
        log_gain, slope = self._loop.log_gain(theta)
        closed = 1.0 / (1.0 + np.exp(log_gain - 1j * self._delay * theta))
        value = 2.0 * np.log(2.0 * np.sin(0.5 * theta) * np.abs(closed))
        change = 1.0 / np.tan(0.5 * theta)
        change -= 2.0 * ((1.0 - closed) * (slope - 1j * self._delay)).real
        steps = [one.log_gain(theta) for one in self._steps]
        return (
            np.array([value + 2.0 * step.real for step, _ in steps]),
            np.array([change + 2.0 * step.real for _, step in steps]),
        )

    def largest_delay(self) -> tuple[float, float]:
        """Return the delay at which the condition fails, in steps, with M_r linear between whole
        delays, and the angle at which it fails."""
        delay = math.nan
        for _ in range(_POLISHES):
            before, (delay, angle) = delay, self._solved()
            if abs(delay - before) <= 1e-13 * delay:
                break
            self._insert_peaks(self._missing(delay) / delay)
        return delay, angle

    def _missing(self, delay: float) -> np.ndarray:
        """Return the number of changes that a delay leaves out in each step, M_r."""
        n = len(self._steps)
        whole = math.floor(delay / n)
        return whole + np.clip(delay - whole * n - np.arange(n), 0.0, 1.0)

    def _solved(self) -> tuple[float, float]:
        """Return the delay at which the condition fails, from the points so far, and the angle."""
        top = float(self._samples.value.max())
        size = np.exp(self._samples.value - top)

        def excess(log_delay: float) -> float:
            largest = float((self._missing(math.exp(log_delay)) @ size).max())
            return log_delay + top + math.log(max(largest, 1e-300))

        # delay/(2 n) <= max M_r <= delay beyond 2 n, and sizes are at most 1.
        low, high = -0.5 * top, max(0.0, -0.5 * top) + math.log(2.0 * len(size))
        found = scipy.optimize.brentq(excess, low - 0.1, high + 0.1, xtol=1e-14, rtol=1e-14)
        delay = math.exp(found)
        return delay, float(self._samples.theta[int(np.argmax(self._missing(delay) @ size))])

    def _insert_peaks(self, weights: np.ndarray) -> None:
        """Add the local maxima of the weighted sum that may be the largest, by halving."""
        theta, total, slope = _summed(weights, self._samples)
        near = total > total.max() - 1.0
        falls = total[1:] <= total[:-1]
        left = np.flatnonzero(near[:-1] & falls & (slope[:-1] > 0.0))
        right = np.flatnonzero(near[1:] & ~falls & (slope[1:] < 0.0)) + 1
        best, size = theta[np.append(left, right)], total[np.append(left, right)]
        other = theta[np.append(left + 1, right - 1)]
        for _ in range(_HALVINGS):
            middle = 0.5 * (best + other)
            _, found, slope = _summed(weights, SampledResponse(middle, *self.at(middle)))
            higher, onward = found > size, slope * (other - best) > 0.0
            other = np.where(higher, np.where(onward, other, best), middle)
            best, size = np.where(higher, middle, best), np.maximum(found, size)
        self._samples = self._samples.with_more(np.setdiff1d(best, theta), self.at)


def _unsure(left: SampledResponse, middle: SampledResponse, right: SampledResponse) -> np.ndarray:
    """Whether the cubic through both ends does not predict the middle, where the sum over all steps
    is large."""
    before, now, after = (_summed(1.0, part) for part in (left, middle, right))
    expected = middle_of_cubic(before, after)
    largest = np.max([before.value, after.value, expected], axis=0)
    return (np.abs(now.value - expected) > _CLOSE) & (largest > largest.max() - _FAR)


def _summed(weights: Any, samples: SampledResponse) -> SampledResponse:
    """Return the log of the weighted sum of the exponentials of all steps, and its slope."""
    top = samples.value.max(axis=0)
    terms = np.exp(samples.value - top) * np.reshape(weights, (-1, 1))
    total = np.maximum(terms.sum(axis=0), 1e-300)
    slope = (terms * samples.slope).sum(axis=0) / total
    return SampledResponse(samples.theta, top + np.log(total), slope)
