"""The priors of keys and nuisances in a fit."""

import math

import numpy as np

from hertzloop.fitting.fit.problem.parameters import FitParameters

_PHASE_SD = math.sqrt(1.0 / 12.0)  # standard deviation of a phase, uniform over a period


def prior_rows(
    parameters: FitParameters, x: np.ndarray, early: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return rows of the priors and their derivatives, (rows,) and (rows, parameters).

    Args:
        parameters: of the fit.
        x: their values.
        early: whether weak priors hold the keys near their start.
    """
    rows, by, n = [], [], len(x)

    def row(place: int, centre: float, sd: float) -> None:
        rows.append((x[place] - centre) / sd)
        line = np.zeros(n)
        line[place] = 1.0 / sd
        by.append(line)

    for j, f in enumerate(parameters.varied_keys):
        if f.prior is not None:
            row(j, math.log(f.start), f.prior)
        elif early:
            row(j, math.log(f.start), f.early_sd)
    shared: set[int] = set()
    for c, at in zip(parameters.channels, parameters.nuisance_indices, strict=True):
        gain_sd, clock_sd = c.prior_sds()
        if at.clock not in shared:
            row(at.clock, 0.0, clock_sd)
        if at.gain not in shared:
            row(at.gain, 1.0, gain_sd)
        shared |= {at.clock, at.gain}
    for phase, period in parameters.phase_periods.items():
        # All phases are as likely, so nothing is pulled; but none is more than a period off.
        row(phase, float(x[phase]), _PHASE_SD * period)
    return np.array(rows), np.array(by).reshape(-1, n)


def prior_pulls(parameters: FitParameters, x: np.ndarray) -> dict[str, float]:
    """Return how far each prior is pulled, in standard deviations, by name."""
    found = {}
    for j, f in enumerate(parameters.varied_keys):
        if f.prior is not None:
            found[f.key] = (float(x[j]) - math.log(f.start)) / f.prior
    for index, c in enumerate(parameters.channels):
        _, ppm, gain, _ = parameters.nuisances(x, index)
        gain_sd, clock_sd = c.prior_sds()
        found[f"{c.record.name}: clock_ppm"] = ppm / clock_sd
        found[f"{c.record.name}: gain"] = (gain - 1.0) / gain_sd
    return found
