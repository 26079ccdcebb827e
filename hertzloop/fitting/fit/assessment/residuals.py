"""What a fit leaves of the records: nuisances, residuals, curves."""

import math

import numpy as np

from hertzloop.fitting.fit.channels.channel import Channel
from hertzloop.fitting.fit.channels.discrepancy import PULSE
from hertzloop.fitting.fit.keys.key_scope import values_for_record
from hertzloop.fitting.fit.problem.iterate import ChannelIterate, Iterate
from hertzloop.fitting.fit.problem.problem import FitProblem
from hertzloop.fitting.fit.results import Nuisance


def describe_nuisances(problem: FitProblem, iterate: Iterate) -> list[Nuisance]:
    """Return nuisance parameters and residual of every record."""
    found = []
    for index, (c, one) in enumerate(zip(problem.channels, iterate.channels, strict=True)):
        touch_s, ppm, gain, offset = problem.nuisances(iterate.x, index)
        rows = iterate.residual[one.rows]
        samples = independent_samples(c, one)
        shares = c.discrepancy.shares if c.discrepancy else (0.0, 0.0)
        contact_s = problem.simulators[index].contact_s
        found.append(
            Nuisance(
                c.record.name,
                touch_s,
                gain,
                offset,
                ppm,
                c.noise,
                math.sqrt(float(np.sum(rows**2)) / samples) if samples else math.nan,
                len(rows),
                c.rejected,
                *_residual_percent(c, one, contact_s, iterate.until_s),
                *(100.0 * share for share in shares),
            )
        )
    return found


def residual_curves(problem: FitProblem, iterate: Iterate) -> list[dict[str, np.ndarray]]:
    """Return measured and simulated values of every record over the time after the touch.

    Returns:
        Arrays `time_s` (s), `measured` and `simulated` (SI unit of the quantity) and `used` (bool)
        for each record, (samples,) each.
    """
    found = []
    for c, one in zip(problem.channels, iterate.channels, strict=True):
        inside = one.predicted.tau <= iterate.until_s
        found.append(
            {
                "time_s": one.predicted.tau[inside],
                "measured": c.value[inside],
                "simulated": one.predicted.reading[inside],
                "used": c.kept[inside],
            }
        )
    return found


def independent_samples(channel: Channel, one: ChannelIterate) -> float:
    """Return how many independent samples of a channel count."""
    return float(np.sum(channel.independent(one.counted)))


def impact_speeds(problem: FitProblem, values: dict[str, float]) -> tuple[float, float]:
    """Return the least and the largest impact speed of the records, m/s.

    Args:
        problem: the fit.
        values: scene keys that differ from those of its simulators.
    """
    speeds = [
        simulator.spec_of(values_for_record(values, c.record)).sphere.impact_speed_m_s
        for simulator, c in zip(problem.simulators, problem.channels, strict=True)
    ]
    return min(speeds), max(speeds)


def _residual_percent(
    c: Channel, one: ChannelIterate, contact_s: float, until_s: float
) -> tuple[float | None, float | None, float]:
    """Residual over the peak: its root mean square in the pulse and after it, None without samples
    there, and its largest value, %."""
    tau, residual = one.predicted.tau, one.predicted.reading - c.value
    used = c.kept & (tau <= until_s) & (tau > -0.1 * contact_s)
    pulse = tau < PULSE * contact_s

    def rms(some: np.ndarray) -> float | None:
        if not np.any(some):
            return None
        return 100.0 * math.sqrt(float(np.mean(residual[some] ** 2))) / c.peak

    largest = float(np.max(np.abs(residual[used]), initial=0.0))
    return rms(used & pulse), rms(used & ~pulse), 100.0 * largest / c.peak
