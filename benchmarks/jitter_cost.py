"""Cost of an integrator under white noise and timing jitter: example 1 of JitterTime.

JitterTime (Cervin and others 2019) computes the cost of linear loops with varying timing. Its first
example is an integrator with a minimum-variance controller. Here the integrator is the response of
`hertzloop.linear` for a structure that is one rigid body, whose velocity is sampled. Process noise
and cost, which hertzloop does not have, are those of this program.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import scipy

from benchmarks.program import OutDirOption, QuickOption, start
from benchmarks.results import results_in
from benchmarks.scenes import load
from hertzloop.api import linear
from hertzloop.cli.options import JsonOption

_STEPS = 20  # in a sampling period, which is the unit of time
_GAIN = (3.0 + math.sqrt(3.0)) / (2.0 + math.sqrt(3.0))  # of the minimum-variance controller
_PERIODS = 200  # until the covariance does not change
_PUBLISHED = 7.420841162336913  # JitterTime.jl, test/example_1_test.jl: six periods, three off


@dataclass(frozen=True)
class Cost:
    """A cost, as obtained and as expected."""

    case: str
    obtained: float
    expected: float


class Loop:
    """Integrator, command that acts, and command that is on its way: maps of the state, of one step
    and of its events, with time in periods. `cost` is the integral of the output's variance."""

    def __init__(self) -> None:
        with TemporaryDirectory() as folder:
            modes = Path(folder, "rigid.csv")
            modes.write_text("frequency_hz,loss_factor,modal_mass_kg,shape_contact\n0,0,1,1\n")
            keys = [f"plate.modes={modes}", "plate.residual_flexibility_m_n=0"]
            system = linear(load("aluminium-3mm", [*keys, "controller.law=off"]), "v_p")
        a, b, c, _ = system.to_statespace()
        n, dt = len(a), 1.0 / _STEPS
        b = b * dt / system.step_s  # the same integrator in another unit of time
        self.output = np.append(c[0], [0.0, 0.0])
        self.step, self.sample, self.act = np.eye(n + 2), np.eye(n + 2), np.eye(n + 2)
        self.step[:n, :n], self.step[:n, n] = a, b[:, 0]
        self.sample[n + 1] = -_GAIN * self.output
        self.act[n, n : n + 2] = 0.0, 1.0
        self.noise = np.zeros((n + 2, n + 2))
        self.noise[:n, :n] = b @ b.T / dt
        self.covariance, self.cost = np.zeros((n + 2, n + 2)), 0.0

    def wait(self, steps: int) -> None:
        """Let an even number of steps pass; Simpson's rule is exact for this variance."""
        variances = [self.output @ self.covariance @ self.output]
        for _ in range(steps):
            self.covariance = self.step @ self.covariance @ self.step.T + self.noise
            variances.append(self.output @ self.covariance @ self.output)
        self.cost += float(scipy.integrate.simpson(variances, dx=1.0 / _STEPS)) if steps else 0.0

    def period(self, delay: int, controlled: bool = True) -> None:
        """Sample, and let the command act `delay` steps later."""
        if controlled:
            self.covariance = self.sample @ self.covariance @ self.sample.T
        self.wait(delay)
        if controlled:
            self.covariance = self.act @ self.covariance @ self.act.T
        self.wait(_STEPS - delay)


def published() -> Cost:
    """Return the cost of six periods from zero, of which the first three are without control."""
    loop = Loop()
    for number in range(6):
        loop.period(0, controlled=number >= 3)
    return Cost("six periods, JitterTime", loop.cost, _PUBLISHED)


def stationary(delays: list[int]) -> Cost:
    """Return the cost of a period in the long run, for delays that are drawn anew in each; steps.

    The Lyapunov equation of the mean over the delays is solved by iteration.
    """
    loop, costs = Loop(), [0.0]
    for _ in range(_PERIODS):
        before, after, costs = loop.covariance, [], []
        for delay in delays:
            loop.covariance, loop.cost = before, 0.0
            loop.period(delay)
            after.append(loop.covariance)
            costs.append(loop.cost)
        loop.covariance = np.mean(after, axis=0)
    case = f"delay 0 to {max(delays) / _STEPS:g} periods" if any(delays) else "no delay"
    return Cost(case, float(np.mean(costs)), by_hand(np.array(delays) / _STEPS))


def by_hand(delay: np.ndarray) -> float:
    """Return the same from the moments of the integrator x and its last command u; periods."""
    g, rest = _GAIN, 1.0 - delay
    keeps = 1.0 - rest * g  # x becomes keeps x + delay u + noise, and u becomes -g x
    u_by_x = -g * np.mean(keeps) / (1.0 + g * np.mean(delay))  # E[x u] over E[x x]
    gains = keeps**2 + 2.0 * keeps * delay * u_by_x + (g * delay) ** 2
    x2 = 1.0 / (1.0 - np.mean(gains))
    xu, u2 = u_by_x * x2, g**2 * x2
    until = delay * x2 + delay**2 * xu + delay**3 / 3.0 * u2
    y2, yu = x2 + 2.0 * delay * xu + delay**2 * u2, -g * (x2 + delay * xu)  # y: x when u changes
    return float(np.mean(until + rest * y2 + rest**2 * yu + rest**3 / 3.0 * u2)) + 0.5


def main(
    folder: OutDirOption = None, quick: QuickOption = False, json_file: JsonOption = None
) -> None:
    """Compare costs of an integrator with JitterTime and with moments by hand.

    --quick changes nothing: it takes a second.

    Example: python -m benchmarks.jitter_cost
    """
    with results_in(folder, "jitter_cost", "modal", json_file=json_file) as results:
        found = [published(), stationary([0]), stationary(list(range(0, _STEPS // 2 + 1, 2)))]
        results.write("cost", found)
        columns = {
            "case": "{.case}",
            "obtained": "{.obtained:.12f}",
            "expected": "{.expected:.12f}",
        }
        results.table("cost of example 1", columns, found)
        worst = max(abs(one.obtained / one.expected - 1.0) for one in found)
        results.conclude(f"The costs differ by {worst:.1e} at most.")


if __name__ == "__main__":
    start("benchmarks.jitter_cost")
