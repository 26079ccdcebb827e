"""What a fit leaves of the records: nuisances, residuals, curves."""

import math

import numpy as np

from hertzloop.identification.fit.channel import Channel
from hertzloop.identification.fit.discrepancy import PULSE
from hertzloop.identification.fit.iterate import Iterate
from hertzloop.identification.fit.key_values import ignored_without_control, values_for_record
from hertzloop.identification.fit.problem import FitProblem
from hertzloop.identification.fit.results import Nuisance


def describe_nuisances(problem: FitProblem, iterate: Iterate, until_s: float) -> list[Nuisance]:
    """Return nuisance parameters and residual of every record, with the samples up to `until_s`
    after the touch."""
    found = []
    for index, c in enumerate(problem.channels):
        touch_s, ppm, gain, offset = problem.nuisances(iterate.x, index)
        rows = iterate.residual[iterate.channel_rows[index]]
        samples = independent_samples(problem, iterate, index, until_s)
        rms = math.sqrt(float(np.sum(rows**2)) / samples) if samples else math.nan
        shares = c.discrepancy.shares if c.discrepancy else (0.0, 0.0)
        found.append(
            Nuisance(
                c.record.name,
                touch_s,
                gain,
                offset,
                ppm,
                c.noise,
                rms,
                len(rows),
                c.rejected,
                _residual_percent(problem, iterate, index, until_s),
                (100.0 * shares[0], 100.0 * shares[1]),
            )
        )
    return found


def residual_curves(
    problem: FitProblem, iterate: Iterate, until_s: float
) -> list[dict[str, np.ndarray]]:
    """Return measured and simulated values of every record over the time after the touch.

    Returns:
        Arrays `time_s` (s), `measured` and `simulated` (SI unit of the quantity) and `used` (bool)
        for each record, (samples,) each.
    """
    found = []
    for index, c in enumerate(problem.channels):
        predicted = problem.predict(iterate.x, index, until_s)
        inside = predicted.tau <= until_s
        found.append(
            {
                "time_s": predicted.tau[inside],
                "measured": c.value[inside],
                "simulated": predicted.reading[inside],
                "used": c.kept[inside],
            }
        )
    return found


def note_other_impact(c: Channel, curve: dict[str, np.ndarray]) -> list[str]:
    """Return a sentence on an impact in a record of the force that the simulation does not have."""
    if c.record.quantity != "contact_force":
        return []
    high = 0.1 * c.peak
    measured = np.where(curve["used"], curve["measured"] - c.baseline, 0.0) > high
    simulated = curve["simulated"] - np.min(curve["simulated"]) > 0.01 * c.peak
    late = curve["time_s"] > curve["time_s"][np.argmax(curve["simulated"])]
    alone = measured & ~simulated & late
    found = np.flatnonzero(alone[:-1] & alone[1:])
    if not len(found):
        return []
    return [
        f"{c.record.name}: an impact {1e6 * curve['time_s'][found[0]]:.3g} us after the first is "
        "not in the simulation. If it is another drop or hit, cut the record before it."
    ]


def independent_samples(problem: FitProblem, iterate: Iterate, index: int, until_s: float) -> float:
    """Return how many independent samples of channel `index` count."""
    channel = problem.channels[index]
    touch_s, ppm, _, _ = problem.nuisances(iterate.x, index)
    tau = channel.after_touch_s(touch_s, ppm)
    return float(np.sum(channel.independent(channel.counted(tau <= until_s))))


def impact_speeds(problem: FitProblem, values: dict[str, float]) -> tuple[float, float]:
    """Return the least and the largest impact speed of the records, m/s.

    Args:
        problem: the fit.
        values: scene keys that differ from those of its models.
    """
    alone = {k: v for k, v in values.items() if not ignored_without_control(k)}
    speeds = [
        m.spec_of(values_for_record(alone, c.record)).sphere.impact_speed_m_s
        for m, c in zip(problem.models, problem.channels, strict=True)
    ]
    return min(speeds), max(speeds)


def _residual_percent(
    problem: FitProblem, iterate: Iterate, index: int, until_s: float
) -> tuple[float | None, float | None, float | None]:
    """Residual over the peak: its root mean square in the pulse and after it, and its largest
    value, %; None without samples there."""
    c, contact_s = problem.channels[index], problem.models[index].contact_s
    predicted = problem.predict(iterate.x, index, until_s)
    tau, residual = predicted.tau, predicted.reading - c.value
    used = c.kept & (tau <= until_s) & (tau > -0.1 * contact_s)
    pulse = tau < PULSE * contact_s

    def rms(some: np.ndarray) -> float | None:
        if not np.any(some):
            return None
        return 100.0 * math.sqrt(float(np.mean(residual[some] ** 2))) / c.peak

    largest = float(np.max(np.abs(residual[used]), initial=0.0))
    return rms(used & pulse), rms(used & ~pulse), 100.0 * largest / c.peak
