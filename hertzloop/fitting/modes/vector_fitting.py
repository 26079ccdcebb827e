"""Starting poles of frequency responses by vector fitting (Gustavsen and Semlyen 1999).

The poles are relocated one point at a time, as Deschrijver 2008 describes.
"""

import numpy as np

from hertzloop.fitting.modes.response_rows import LEAST_LOSS, MOST_LOSS, real_rows

_ROUNDS = 10  # relocations of the poles
_FIRST_DAMPING = 0.01  # damping ratio of the first poles
_LEAST_OMEGA = 1e-6  # least frequency, over the highest of the lines


def start_poles(
    s: np.ndarray, receptances: np.ndarray, weights: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies (rad/s) and loss factors by vector fitting.

    Args:
        s: imaginary unit times the angular frequencies of the lines, rad/s, (lines,).
        receptances: m/N, (points, lines).
        weights: their weights, (points, lines).
        count: number of modes.

    Returns:
        Frequencies and loss factors, (modes,) each.
    """
    scale = float(np.abs(s).max())
    x, low = s / scale, float(np.abs(s).min()) / scale
    poles = np.linspace(low, 1.0, count) * (1j - _FIRST_DAMPING)
    rest = np.array([np.ones_like(x), x**2, x**4])
    for _ in range(_ROUNDS):
        a, b = 1.0 / (x - poles[:, None]), 1.0 / (x - poles.conj()[:, None])
        fractions = np.concatenate([a + b, 1j * (a - b)])
        rows, right = [], []
        for values, weight in zip(receptances, weights, strict=True):
            own = real_rows(np.concatenate([fractions, rest]) * weight).T
            own = own / np.linalg.norm(own, axis=0)
            shared = real_rows(-fractions * values * weight).T
            y = real_rows(values * weight)[:, None]
            r = np.asarray(np.linalg.qr(np.concatenate([own, shared, y], axis=1), mode="r"))
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
        zeros = -np.abs(zeros.real) + 1j * zeros.imag  # Unstable poles are mirrored.
        upper, real = zeros[zeros.imag > 0.0], np.sort(-zeros[zeros.imag == 0.0].real)
        # Two real poles become a pair of high damping.
        pairs = np.sqrt(real[::2] * real[1::2]) * (-0.5 + 0.866j)
        poles = np.concatenate([upper, pairs])
        poles = poles[np.argsort(poles.imag)]
    omega = np.maximum(np.abs(poles), _LEAST_OMEGA)
    loss = np.clip(-2.0 * poles.real / omega, LEAST_LOSS, MOST_LOSS)
    return scale * omega, loss
