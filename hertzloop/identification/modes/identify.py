"""Modes of measured responses, without a person who picks them.

A response is s^n (sum R_k/(s^2 + eta_k w_k s + w_k^2) + rest) times the force, with real residues
R_k: those of normal modes. All w_k and eta_k are fitted together by least squares, with the
residues eliminated (variable projection: Golub and Pereyra 1973, Kaufman's Jacobian). Modes are
added where they explain most of what is left (orthogonal matching pursuit) and removed where that
is not worth their numbers. Starting poles of frequency responses come from vector fitting
(Gustavsen and Semlyen 1999; one point at a time, as Deschrijver 2008).
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy

FLEXIBILITY_M_N = 1e-9  # unit of the rest of a response
_WORTH = 3.0  # of ln(rows) times the mean square: what a mode has to explain
_EXACT = 1e-14  # of the sum of squares: what rounding leaves
# Share of its own square that a mode has to explain, where no drive point keeps residues positive:
# modes that explain less take on huge residues that cancel.
_CANCELLING = 0.01
_ROUNDS, _GAIN = 12, 1e-3  # steps of a fit, and the relative gain of a step that ends it
_POLE_ROUNDS = 10  # of vector fitting
_STEP, _STEP_LOSS = 0.03, 1.0  # largest change of the logarithms in a step
_LEAST_LOSS, _MOST_LOSS = 1e-7, 1.0
_APART = 0.02  # of their frequency, between modes that are added together
_PER_ROUND = 4  # modes that are added together
_BETTER, _PATIENCE = 0.04, 2  # what counts as a smaller error, and rounds without
_CHUNK = 100  # candidates that are tried together
_DIFFERENCE = 1e-6  # of logarithms, for derivatives


@dataclass(frozen=True)
class ResponseRows:
    """Measured responses to known forces, of several points to one.

    `basis`: rows of a response to the force for modes of unit residue, by frequencies (rad/s) and
    loss factors: (modes,) -> (modes, rows). `rest`: what stands for the modes beyond the band,
    (terms, rows). `values`, `weights`: measured rows and their weights, (points, rows), real or
    complex. `band_hz`: lowest and highest frequency of a mode. `resolution_hz`: how far
    frequencies are apart that can be told. `drive`: the point of the force, where no passive
    structure has a negative residue; None if it is none of the points. `least_width_hz`: least
    bandwidth of a mode.
    """

    basis: Callable[[np.ndarray, np.ndarray], np.ndarray]
    rest: np.ndarray
    values: np.ndarray
    weights: np.ndarray
    band_hz: tuple[float, float]
    resolution_hz: float
    drive: int | None = None
    least_width_hz: float = 0.0

    def columns(self, omega: np.ndarray, loss: np.ndarray) -> np.ndarray:
        """Rows of all modes and the rest, (modes + terms, rows)."""
        return np.concatenate([self.basis(omega, loss), self.rest])

    @property
    def count(self) -> int:
        """How many real numbers were measured."""
        return self.values.size * (2 if np.iscomplexobj(self.values) else 1)


@dataclass(frozen=True)
class FittedModes:
    """Modes of responses.

    `omega_rad_s`, `loss_factor`: (modes,). `residues`: of receptances, 1/kg, (points, modes).
    `rest`: factors of the terms beyond the band, (points, terms). `square`: weighted sum of
    squares.
    """

    omega_rad_s: np.ndarray
    loss_factor: np.ndarray
    residues: np.ndarray
    rest: np.ndarray
    square: float

    def response(self, observed: ResponseRows) -> np.ndarray:
        """What the modes respond to other forces, (points, rows)."""
        columns = observed.columns(self.omega_rad_s, self.loss_factor)
        return np.concatenate([self.residues, self.rest], axis=1) @ columns


def real_rows(rows: np.ndarray) -> np.ndarray:
    """Real and imaginary parts, one behind the other; (..., rows) -> (..., rows or twice that)."""
    return np.concatenate([rows.real, rows.imag], axis=-1) if np.iscomplexobj(rows) else rows


@dataclass(frozen=True)
class _LinearFit:
    """The linear fit of one point: its matrix `g` (rows, columns), an orthonormal basis `q` of it,
    the factors `x` and what is `left` (rows,)."""

    g: np.ndarray
    q: np.ndarray
    x: np.ndarray
    left: np.ndarray
    weights: np.ndarray

    def across(self, columns: np.ndarray) -> np.ndarray:
        """Other columns (modes, rows), weighted, without what the matrix explains of them."""
        other = real_rows(columns * self.weights).T
        return other - self.q @ (self.q.T @ other)


def _linear(observed: ResponseRows, columns: np.ndarray) -> list[_LinearFit]:
    found: list[_LinearFit] = []
    for values, weights in zip(observed.values, observed.weights, strict=True):
        g = real_rows(columns * weights).T
        size = np.linalg.norm(g, axis=0)
        size[size == 0.0] = 1.0
        q, r = np.linalg.qr(g / size)
        y = real_rows(values * weights)
        x = np.linalg.lstsq(r, q.T @ y, rcond=1e-13)[0] / size
        if len(found) == observed.drive and np.any(x[: len(x) - len(observed.rest)] < 0.0):
            # The rest may have any sign, so it comes twice.
            both = np.concatenate([r, -r[:, len(x) - len(observed.rest) :]], axis=1)
            x, more = np.split(scipy.optimize.nnls(both, q.T @ y)[0], [len(x)])
            x[len(x) - len(more) :] -= more
            q = np.linalg.qr((g / size)[:, x != 0.0])[0]
            x /= size
        found.append(_LinearFit(g, q, x, y - g @ x, weights))
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
    """Return the modes near some frequencies (rad/s) and loss factors that fit best."""
    n, damping = len(omega), 1e-2
    columns = observed.columns(omega, loss)
    points = _linear(observed, columns)
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
        for _ in range(8):
            step = np.linalg.solve(normal + np.diag(damping * size), slope)
            new = omega * np.exp(np.clip(step[:n], -_STEP, _STEP))
            new_loss = loss * np.exp(np.clip(step[n:], -_STEP_LOSS, _STEP_LOSS))
            least = np.maximum(_LEAST_LOSS, 2.0 * math.pi * observed.least_width_hz / new)
            new_loss = np.clip(new_loss, least, _MOST_LOSS)
            tried = observed.columns(new, new_loss)
            better = _linear(observed, tried)
            if _square(better) < before:
                break
            damping *= 5.0
        else:
            break
        omega, loss, columns, points = new, new_loss, tried, better
        damping = max(damping / 5.0, 1e-9)
        if _square(points) > (1.0 - gain) * before:
            break
    order, factors = np.argsort(omega), np.array([point.x for point in points])
    return FittedModes(
        omega[order], loss[order], factors[:, order], factors[:, n:], _square(points)
    )


def _triangle(matrix: np.ndarray) -> np.ndarray:
    """R of a matrix Q R."""
    return np.asarray(np.linalg.qr(matrix, mode="r"))


def _gains(points: list[_LinearFit], n: int) -> tuple[np.ndarray, np.ndarray]:
    """By how much the sum of squares grows without each mode, and that of what it contributes,
    both (modes,)."""
    found, own = np.zeros(n), np.zeros(n)
    for point in points:
        size = np.linalg.norm(point.g, axis=0)
        size[size == 0.0] = 1.0
        variance = np.sum(np.linalg.pinv(_triangle(point.g / size)) ** 2, axis=1)
        squares = (point.x * size) ** 2
        found += (squares / np.maximum(variance, 1e-300))[:n]
        own += squares[:n]
    return found, own


def remove_weak_modes(observed: ResponseRows, modes: FittedModes) -> FittedModes:
    """Return the modes that are worth their numbers, refined."""
    omega, loss = modes.omega_rad_s, modes.loss_factor
    exact = _EXACT * float(np.sum(np.abs(observed.values * observed.weights) ** 2))
    while len(omega):
        points = _linear(observed, observed.columns(omega, loss))
        worth, own = _gains(points, len(omega))
        least = max(_WORTH * math.log(observed.count) / observed.count * _square(points), exact)
        needed = np.full(len(omega), least)
        if observed.drive is None:
            needed = np.maximum(needed, _CANCELLING * own)
        weakest = int(np.argmin(worth / needed))
        if worth[weakest] > needed[weakest]:
            break
        omega, loss = np.delete(omega, weakest), np.delete(loss, weakest)
    return modes if len(omega) == len(modes.omega_rad_s) else refine_modes(observed, omega, loss)


def remove_modes_below(observed: ResponseRows, modes: FittedModes, share: float) -> FittedModes:
    """Return the modes without those that explain less than a share of the squares left, once the
    others are refined. Only weak modes, and those within the bandwidth of another, are tried."""
    while True:
        omega, loss = modes.omega_rad_s, modes.loss_factor
        points = _linear(observed, observed.columns(omega, loss))
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


def _candidates(
    observed: ResponseRows, loss: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Frequencies (rad/s) and loss factors that a further mode may have."""
    low, high = observed.band_hz
    hz = np.linspace(low, high, int(min(2000, max(300, (high - low) / observed.resolution_hz))))
    middle = float(np.median(loss)) if len(loss) else 0.01
    for some in np.array_split(2.0 * np.pi * hz, -(-len(hz) // _CHUNK)):
        yield some, np.full(len(some), middle)


def add_modes(observed: ResponseRows, modes: FittedModes) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies and loss factors of the modes and those that explain most of what they
    leave."""
    points = _linear(observed, observed.columns(modes.omega_rad_s, modes.loss_factor))
    tried, scores = [], []
    for omega, loss in _candidates(observed, modes.loss_factor):
        columns, score = observed.basis(omega, loss), np.zeros(len(omega))
        for i, point in enumerate(points):
            across = point.across(columns)
            size = np.linalg.norm(real_rows(columns * point.weights), axis=1)
            new = np.maximum(np.linalg.norm(across, axis=0), 1e-3 * size)
            along = across.T @ point.left
            if i == observed.drive:
                along = np.maximum(along, 0.0)
            score += (along / np.where(new > 0.0, new, 1.0)) ** 2
        tried.append((omega, loss))
        scores.append(score)
    omega, loss = (np.concatenate(parts) for parts in zip(*tried, strict=True))
    chosen: list[int] = []
    for i in np.argsort(-np.concatenate(scores)):
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
    tell: Callable[[int, float], None] | None = None,
) -> FittedModes:
    """Return the modes whose error in data that were held out is least.

    Args:
        observed: what is fitted.
        error: error of some modes, on data that are not in `observed`.
        start: frequencies (rad/s) and loss factors to begin with; none if left out.
        most: largest number of modes.
        tell: is told the number of modes and their error, round by round.
    """
    omega, loss = start if start is not None else (np.zeros(0), np.zeros(0))
    best, least, since = refine_modes(observed, omega, loss, 0), math.inf, 0
    while True:
        modes = remove_weak_modes(observed, refine_modes(observed, omega, loss))
        found = error(modes)
        if tell is not None:
            tell(len(modes.omega_rad_s), found)
        grown = len(modes.omega_rad_s) > len(best.omega_rad_s)
        since = 0 if found < (1.0 - _BETTER) * least else since + 1 if grown else _PATIENCE
        if found < least:
            best, least = modes, found
        if since >= _PATIENCE or len(omega) >= most:
            return best
        omega, loss = add_modes(observed, modes)


def start_poles(
    s: np.ndarray, receptances: np.ndarray, weights: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies (rad/s) and loss factors by vector fitting.

    Args:
        s: j w of the lines, rad/s, (lines,).
        receptances: m/N, (points, lines).
        weights: their weights, (points, lines).
        count: number of modes.
    """
    scale = float(np.abs(s).max())
    x, low = s / scale, float(np.abs(s).min()) / scale
    poles = np.linspace(low, 1.0, count) * (1j - 0.01)
    rest = np.array([np.ones_like(x), x**2, x**4])
    for _ in range(_POLE_ROUNDS):
        a, b = 1.0 / (x - poles[:, None]), 1.0 / (x - poles.conj()[:, None])
        fractions = np.concatenate([a + b, 1j * (a - b)])
        rows, right = [], []
        for values, weight in zip(receptances, weights, strict=True):
            own = real_rows(np.concatenate([fractions, rest]) * weight).T
            own = own / np.linalg.norm(own, axis=0)
            shared = real_rows(-fractions * values * weight).T
            y = real_rows(values * weight)[:, None]
            r = _triangle(np.concatenate([own, shared, y], axis=1))
            first = len(own.T)
            rows.append(r[first:-1, first:-1])
            right.append(r[first:-1, -1])
        matrix = np.concatenate(rows)
        size = np.linalg.norm(matrix, axis=0)
        factors = np.linalg.lstsq(matrix / size, np.concatenate(right), rcond=1e-14)[0] / size
        companion = np.zeros((2 * count, 2 * count))
        for k, pole in enumerate(poles):
            i = 2 * k
            companion[i : i + 2, i : i + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
        taken = np.stack([factors[:count], factors[count:]], axis=1).ravel()
        companion[::2] -= 2.0 * taken
        zeros = np.linalg.eigvals(companion)
        zeros = -np.abs(zeros.real) + 1j * zeros.imag  # unstable ones are mirrored
        upper, real = zeros[zeros.imag > 0.0], np.sort(-zeros[zeros.imag == 0.0].real)
        # Two real poles become a pair that is well damped.
        pairs = np.sqrt(real[::2] * real[1::2]) * (-0.5 + 0.866j)
        poles = np.concatenate([upper, pairs])
        poles = poles[np.argsort(poles.imag)]
    omega = np.maximum(np.abs(poles), 1e-6)
    loss = np.clip(-2.0 * poles.real / omega, _LEAST_LOSS, _MOST_LOSS)
    return scale * omega, loss
