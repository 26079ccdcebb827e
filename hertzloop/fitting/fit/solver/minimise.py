"""Minimise the squared residuals of a fit by damped Gauss-Newton steps."""

import math

import numpy as np

from hertzloop.fitting.fit.problem.iterate import Iterate
from hertzloop.fitting.fit.problem.problem import FitProblem
from hertzloop.scene.errors import SceneError

_MOST_PHASE = 0.1  # periods that a step changes a phase by


def minimise(
    problem: FitProblem,
    x: np.ndarray,
    until_s: float,
    early: bool = False,
    steps: int = 40,
    tolerance: float = 1e-7,
) -> Iterate:
    """Minimise the squared residuals within the bounds by damped Gauss-Newton steps.

    Args:
        problem: what is fitted.
        x: where to start.
        until_s: end of the window after the touch, s.
        early: whether weak priors hold the keys near their start.
        steps: most steps.
        tolerance: relative fall of chi-square that ends it.

    Returns:
        The best point found, with its Jacobian.
    """
    low = np.full(len(x), -np.inf)
    high = np.full(len(x), np.inf)
    for j, f in enumerate(problem.varied_keys):
        low[j], high[j] = math.log(f.low), math.log(f.high)
    x = np.clip(x, low, high)
    now = problem.evaluate(x, until_s, early)
    damping = 1e-3
    for _ in range(steps):
        scale = np.sqrt(np.sum(now.jacobian**2, axis=0))
        scale[scale == 0.0] = 1.0
        gradient = now.jacobian.T @ now.residual
        # Parameters that a bound holds do not take part.
        held = ((x <= low) & (gradient > 0.0)) | ((x >= high) & (gradient < 0.0))
        open_ = np.flatnonzero(~held)
        j = now.jacobian[:, open_] / scale[open_]
        improved = False
        for _ in range(8):
            big = np.concatenate([j, math.sqrt(damping) * np.eye(len(open_))])
            wanted = np.concatenate([-now.residual, np.zeros(len(open_))])
            move = np.linalg.lstsq(big, wanted, rcond=None)[0] / scale[open_]
            new = x.copy()
            new[open_] += _limit_step(problem, move, open_)
            new = np.clip(new, low, high)
            try:
                tried = problem.evaluate(new, until_s, early, jacobian=False)
            except SceneError:
                damping *= 10.0
                continue
            # A touch beyond the record leaves no residual, but it explains nothing.
            lost = tried.empty_channels > now.empty_channels
            if tried.chi_square < now.chi_square and not lost:
                improved = True
                break
            damping = max(damping * 6.0, 1e-6)
        if not improved:
            break
        fall = now.chi_square - tried.chi_square
        x = new
        now = problem.evaluate(x, until_s, early)
        damping = max(damping * 0.1, 1e-9)
        if fall < tolerance * (1.0 + now.chi_square):
            break
    return now


def _limit_step(problem: FitProblem, move: np.ndarray, places: np.ndarray) -> np.ndarray:
    """A step that changes no key by more than a third, and no phase by more than a tenth of its
    period: beyond, derivatives mean little."""
    for at, period in problem.phase_periods.items():
        of_phase = places == at
        move[of_phase] = np.clip(move[of_phase], -_MOST_PHASE * period, _MOST_PHASE * period)
    keys = places < len(problem.varied_keys)
    most = float(np.max(np.abs(move[keys]), initial=0.0))
    return move * (0.3 / most) if most > 0.3 else move
