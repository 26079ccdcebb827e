"""Modes of measured responses, found without a person who picks them.

All frequencies and loss factors are fitted together by least squares, with the residues eliminated
(variable projection: Golub and Pereyra 1973, Kaufman's Jacobian). Modes are added where they
explain most of what is left (orthogonal matching pursuit), and removed where they explain too
little for their parameters.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from hertzloop.fitting.modes.response_rows import (
    LEAST_LOSS,
    MOST_LOSS,
    FittedModes,
    ResponseRows,
    real_rows,
)

_LEAST_GAIN = 3.0  # a mode has to explain so many ln(rows) times the mean square
_ROUNDING = 1e-14  # share of the sum of squares that rounding leaves
# Share of its own square that a mode has to explain, where no drive point keeps residues positive.
# Modes that explain less take on huge residues that cancel.
_CANCELLING = 0.01
_ROUNDS, _GAIN = 12, 1e-3  # most steps of a fit; least relative gain of a step
_STEP, _STEP_LOSS = 0.03, 1.0  # largest change of the logarithms in a step
_APART = 0.02  # least relative distance of the frequencies of modes that are added together
_PER_ROUND = 4  # most modes that are added together
_BETTER, _PATIENCE = 0.04, 2  # least relative gain of a round; most rounds in a row without one
_FEWEST_TRIED, _MOST_TRIED = 300, 2000  # frequencies of a further mode that are tried
_CHUNK = 100  # of these at once
_DIFFERENCE = 1e-6  # difference of logarithms, for derivatives
_TRIES, _HARDER = 8, 5.0  # most tries of a step; factor on its damping after one that fails


@dataclass(frozen=True)
class _LinearFit:
    """The linear fit of one point.

    Args:
        size: norms of its weighted columns, (columns,).
        r: triangular factor of the columns over their norms, (columns, columns).
        q: orthonormal basis of the columns that are used, (rows, columns).
        x: factors of the columns, (columns,).
        left: weighted rows that the fit does not explain, (rows,).
        weights: of the rows, (rows,).
    """

    size: np.ndarray
    r: np.ndarray
    q: np.ndarray
    x: np.ndarray
    left: np.ndarray
    weights: np.ndarray

    def across(self, columns: np.ndarray) -> np.ndarray:
        """Return other columns, (modes, rows), weighted and without their part in the matrix,
        (rows, modes)."""
        other = real_rows(columns * self.weights).T
        return other - self.q @ (self.q.T @ other)


def _fit_points(observed: ResponseRows, columns: np.ndarray) -> list[_LinearFit]:
    """Fit the values of each point by columns, (modes + terms, rows); without negative residues at
    the drive point."""
    found: list[_LinearFit] = []
    for values, weights in zip(observed.values, observed.weights, strict=True):
        g = real_rows(columns * weights).T
        size = np.linalg.norm(g, axis=0)
        size[size == 0.0] = 1.0
        q, r = np.linalg.qr(g / size)
        y = real_rows(values * weights)
        x = np.linalg.lstsq(r, q.T @ y, rcond=1e-13)[0] / size
        if len(found) == observed.drive and np.any(x[: len(x) - len(observed.rest)] < 0.0):
            # The rest may have any sign, so it enters with both signs.
            both = np.concatenate([r, -r[:, len(x) - len(observed.rest) :]], axis=1)
            x, more = np.split(scipy.optimize.nnls(both, q.T @ y)[0], [len(x)])
            x[len(x) - len(more) :] -= more
            q = np.linalg.qr((g / size)[:, x != 0.0])[0]
            x /= size
        found.append(_LinearFit(size, r, q, x, y - g @ x, weights))
    return found


def _square(points: list[_LinearFit]) -> float:
    return float(sum(point.left @ point.left for point in points))


def refine_modes(
    observed: ResponseRows,
    omega: np.ndarray,
    loss: np.ndarray,
    rounds: int = _ROUNDS,
    gain: float = _GAIN,
) -> FittedModes:
    """Return the modes that fit best, near others (Levenberg and Marquardt).

    Args:
        observed: the rows.
        omega: frequencies to begin with, rad/s, (modes,).
        loss: loss factors to begin with, (modes,).
        rounds: most steps; 0 fits the residues alone.
        gain: relative gain of a step below which it is the last.
    """
    n, damping = len(omega), 1e-2
    columns = observed.columns(omega, loss)
    points = _fit_points(observed, columns)
    for _ in range(rounds if n else 0):
        normal, slope = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
        grown = observed.basis(omega * (1.0 + _DIFFERENCE), loss) - columns[:n]
        damped = observed.basis(omega, loss * (1.0 + _DIFFERENCE)) - columns[:n]
        for point in points:
            by = np.concatenate([grown * point.x[:n, None], damped * point.x[:n, None]])
            jacobian = point.across(by / _DIFFERENCE)
            normal += jacobian.T @ jacobian
            slope += jacobian.T @ point.left
        before = _square(points)
        size = np.diag(normal) + 1e-12 * np.max(np.diag(normal)) + 1e-300
        for _ in range(_TRIES):
            step = np.linalg.solve(normal + np.diag(damping * size), slope)
            new = omega * np.exp(np.clip(step[:n], -_STEP, _STEP))
            new_loss = loss * np.exp(np.clip(step[n:], -_STEP_LOSS, _STEP_LOSS))
            least = np.maximum(LEAST_LOSS, 2.0 * math.pi * observed.least_width_hz / new)
            new_loss = np.clip(new_loss, least, MOST_LOSS)
            tried = observed.columns(new, new_loss)
            better = _fit_points(observed, tried)
            if _square(better) < before:
                break
            damping *= _HARDER
        else:
            break
        omega, loss, columns, points = new, new_loss, tried, better
        damping = max(damping / _HARDER, 1e-9)
        if _square(points) > (1.0 - gain) * before:
            break
    order, factors = np.argsort(omega), np.array([point.x for point in points])
    return FittedModes(
        omega[order], loss[order], factors[:, order], factors[:, n:], _square(points)
    )


def _gains(points: list[_LinearFit], n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much the sum of squares grows without each mode, and the sum of squares of its
    own response, (modes,) each."""
    found, own = np.zeros(n), np.zeros(n)
    for point in points:
        variance = np.sum(np.linalg.pinv(point.r) ** 2, axis=1)
        squares = (point.x * point.size) ** 2
        found += (squares / np.maximum(variance, 1e-300))[:n]
        own += squares[:n]
    return found, own


def remove_weak_modes(observed: ResponseRows, modes: FittedModes) -> FittedModes:
    """Return the modes that explain more than their parameters would explain of noise, refined."""
    omega, loss = modes.omega_rad_s, modes.loss_factor
    exact = _ROUNDING * float(np.sum(np.abs(observed.values * observed.weights) ** 2))
    while len(omega):
        points = _fit_points(observed, observed.columns(omega, loss))
        worth, own = _gains(points, len(omega))
        least = max(
            _LEAST_GAIN * math.log(observed.count) / observed.count * _square(points), exact
        )
        needed = np.full(len(omega), least)
        if observed.drive is None:
            needed = np.maximum(needed, _CANCELLING * own)
        weakest = int(np.argmin(worth / needed))
        if worth[weakest] > needed[weakest]:
            break
        omega, loss = np.delete(omega, weakest), np.delete(loss, weakest)
    return modes if len(omega) == len(modes.omega_rad_s) else refine_modes(observed, omega, loss)


def remove_modes_below(observed: ResponseRows, modes: FittedModes, share: float) -> FittedModes:
    """Return the modes without those that explain less than a share of the squares that are left.

    A mode goes if the others, refined, explain almost as much without it. Weak modes and modes
    within the bandwidth of another one are tried.
    """
    while True:
        omega, loss = modes.omega_rad_s, modes.loss_factor
        points = _fit_points(observed, observed.columns(omega, loss))
        worth = _gains(points, len(omega))[0]
        close = np.abs(np.diff(omega)) < (loss * omega)[:-1] + (loss * omega)[1:]
        beside = np.append(close, False) | np.append(False, close)
        for i in np.argsort(worth):
            if worth[i] < share * modes.square or beside[i]:
                tried = refine_modes(observed, np.delete(omega, i), np.delete(loss, i))
                if tried.square < (1.0 + share) * modes.square:
                    modes = tried
                    break
        else:
            return modes


def add_modes(observed: ResponseRows, modes: FittedModes) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies (rad/s) and loss factors, (modes,) each, of the modes and of further ones
    that explain most of what these leave."""
    low, high = observed.band_hz
    count = int(min(_MOST_TRIED, max(_FEWEST_TRIED, (high - low) / observed.resolution_hz)))
    omega = 2.0 * np.pi * np.linspace(low, high, count)
    usual = float(np.median(modes.loss_factor)) if len(modes.loss_factor) else 0.01
    loss = np.full(count, usual)
    points = _fit_points(observed, observed.columns(modes.omega_rad_s, modes.loss_factor))
    scores = np.zeros(count)
    for some in np.array_split(np.arange(count), -(-count // _CHUNK)):
        columns = observed.basis(omega[some], loss[some])
        for i, point in enumerate(points):
            across = point.across(columns)
            size = np.linalg.norm(real_rows(columns * point.weights), axis=1)
            new = np.maximum(np.linalg.norm(across, axis=0), 1e-3 * size)
            along = across.T @ point.left
            if i == observed.drive:
                along = np.maximum(along, 0.0)
            scores[some] += (along / np.where(new > 0.0, new, 1.0)) ** 2
    chosen: list[int] = []
    for i in np.argsort(-scores):
        if all(abs(omega[i] / omega[j] - 1.0) > _APART for j in chosen):
            chosen.append(int(i))
        if len(chosen) == _PER_ROUND:
            break
    return (
        np.concatenate([modes.omega_rad_s, omega[chosen]]),
        np.concatenate([modes.loss_factor, loss[chosen]]),
    )


def identify_modes(
    observed: ResponseRows,
    error: Callable[[FittedModes], float],
    start: tuple[np.ndarray, np.ndarray] | None = None,
    most: int = 200,
    on_round: Callable[[int, float], None] | None = None,
) -> FittedModes:
    """Return the modes whose error in data that were held out is least.

    Args:
        observed: the rows that are fitted.
        error: error of some modes, on data that are not in `observed`.
        start: frequencies (rad/s) and loss factors to begin with; none if left out.
        most: largest number of modes.
        on_round: is called with the number of modes and their error after each round.
    """
    omega, loss = start if start is not None else (np.zeros(0), np.zeros(0))
    best, least, since = refine_modes(observed, omega, loss, 0), math.inf, 0
    while True:
        modes = remove_weak_modes(observed, refine_modes(observed, omega, loss))
        found = error(modes)
        if on_round is not None:
            on_round(len(modes.omega_rad_s), found)
        grown = len(modes.omega_rad_s) > len(best.omega_rad_s)
        since = 0 if found < (1.0 - _BETTER) * least else since + 1 if grown else _PATIENCE
        if found < least:
            best, least = modes, found
        if since >= _PATIENCE or len(omega) >= most:
            return best
        omega, loss = add_modes(observed, modes)
