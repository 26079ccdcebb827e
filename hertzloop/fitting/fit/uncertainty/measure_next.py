"""Say which key to measure by other means."""

from dataclasses import replace

import numpy as np

from hertzloop.fitting.fit.problem.iterate import Iterate
from hertzloop.fitting.fit.problem.problem import FitProblem
from hertzloop.fitting.fit.uncertainty.key_uncertainty import KeyUncertainty, key_uncertainty
from hertzloop.fitting.fit.verdicts import half_width

_KNOWN_TO = 0.01  # relative standard deviation of a key measured by other means


def suggest_measurement(problem: FitProblem, iterate: Iterate, known: KeyUncertainty) -> list[str]:
    """Say which key, measured by other means, would help the worst known key most."""
    n = len(problem.varied_keys)
    if n < 2:
        return []
    widest = half_width(float(np.max(known.sd)))
    if widest <= 0.1:
        return []
    linear = key_uncertainty(problem, iterate).sd
    best: tuple[float, int] | None = None
    for j in range(n):
        line = np.zeros((1, len(iterate.x)))
        line[0, j] = 1.0 / _KNOWN_TO
        more = replace(
            iterate,
            residual=np.append(iterate.residual, 0.0),
            jacobian=np.concatenate([iterate.jacobian, line]),
        )
        sd = key_uncertainty(problem, more).sd
        # `known` may hold more than the linear covariance: converter draws, shifts of windows.
        scale = np.divide(known.sd, linear, out=np.ones(n), where=np.isfinite(linear))
        others = half_width(float(np.max(sd * scale)))
        if best is None or others < best[0]:
            best = (others, j)
    if best is None:
        return []
    key = problem.varied_keys[best[1]].key
    return [
        f"Measure {key} by other means to 1 % and give it as a prior, --free '{key}±1%': the worst "
        f"half-width falls from {_percent(widest)} to {_percent(best[0])}."
    ]


def _percent(share: float) -> str:
    if share >= 10.0:
        return "no bound"
    return f"{100.0 * share:.{2 if share < 1.0 else 3}g} %"
