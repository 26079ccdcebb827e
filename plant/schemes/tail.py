"""The modes left out of a plate, as one damped mode in place of a massless spring.

Above the highest mode taken along, w_c, a plate is a continuum of mobility Y; below it, what
that continuum adds is j (Y/pi) ln((w_c + w)/(w_c - w)). The passive fit with the exact terms in w
and w^3, no loss in w^2 and Y at infinity is, with q = j w,

    Y_t = Y q (q + 6 w_c/pi)/(q^2 + (pi/2) w_c q + 3 w_c^2),

one complex mode. Its real part is Y w^4/|q^2 + ...|^2: with y'' + (pi/2) w_c y' + 3 w_c^2 y = F
it loses the power Y y''^2 and holds
Y ((3/pi + pi/4) w_c y'^2 + 3 w_c^2 y y' + (9/pi) w_c^3 y^2).
"""

import math

import numpy as np

from plant.contact import elastic_kernels as elastic
from plant.contact.tail_kernels import DampedTail
from plant.numerics import phi
from plant.one_thread import gauss

_NODES = 24  # of the time integral of the loss, for a turn of up to pi in a step
_NODES_PER_RADIAN = 0.75


def mobility(mobility_m_ns: float, omega_c: float, omega: np.ndarray) -> np.ndarray:
    """Y_t at angular frequencies (rad/s); m/(N s), same shape."""
    q = 1j * np.asarray(omega)
    below = q * q + 0.5 * math.pi * omega_c * q + 3.0 * omega_c**2
    return np.asarray(mobility_m_ns * q * (q + 6.0 * omega_c / math.pi) / below)


def limit_of(mobility_m_ns: float, flexibility_m_n: float) -> float:
    """w_c (rad/s) at which the mode is as flexible as the modes left out, 2 Y/(pi w_c)."""
    return 2.0 * mobility_m_ns / (math.pi * flexibility_m_n)


def build(
    mobility_m_ns: float, omega_c: float, step_s: float, same_point: bool
) -> tuple[DampedTail, dict[int, float]]:
    """Coefficients of a step, and what the mode adds to the model's gains, index: value."""
    h, y = step_s, mobility_m_ns
    a = 0.25 * math.pi * omega_c
    b = math.sqrt(3.0 * omega_c**2 - a * a)
    s = complex(-a, b)
    drive = complex(y * (6.0 * omega_c / math.pi - a) / b, y)
    x = np.array([s * h])
    turn, one, two, three = (complex(phi(i, x)[0]) for i in range(4))
    constant, linear = h * one * drive, h * s * h * (2.0 * three - two) * drive
    mean_constant, mean_linear = h * two * drive, h * (2.0 * three - two) * drive
    # y and y' from displacement Im z and velocity Im(s z), so from Re z and Im z.
    by_y = y * np.array([
        [6.0 * omega_c / math.pi, 1.0],
        [-3.0 * omega_c**2, (6.0 / math.pi - 0.5 * math.pi) * omega_c],
    ])  # fmt: skip
    to_y = np.linalg.solve(by_y, np.array([[0.0, 1.0], [b, -a]]))
    held = y * np.array([
        [9.0 / math.pi * omega_c**3, 1.5 * omega_c**2],
        [1.5 * omega_c**2, (3.0 / math.pi + 0.25 * math.pi) * omega_c],
    ])  # fmt: skip
    energy = to_y.T @ held @ to_y
    tail = DampedTail(
        turn_re=turn.real,
        turn_im=turn.imag,
        by_0_re=constant.real,
        by_0_im=constant.imag,
        by_1_re=linear.real,
        by_1_im=linear.imag,
        speed_re=b,
        speed_im=-a,
        mean_re=one.imag,
        mean_im=one.real,
        mobility_m_ns=y,
        energy=np.array([energy[0, 0], 2.0 * energy[0, 1], energy[1, 1]]),
        lost=_lost(y, omega_c, s, drive, h, to_y),
    )
    gains = {
        elastic.PX0: constant.imag,
        elastic.PX1: linear.imag,
        elastic.PV0: (s * constant).imag + y,
        elastic.PV1: (s * linear).imag + y,
        elastic.PM0: mean_constant.imag,
        elastic.PM1: mean_linear.imag,
        elastic.START0: y,
        elastic.START1: -y,
    }
    if same_point:
        gains |= {
            elastic.CA: gains[elastic.PX0],
            elastic.VA: gains[elastic.PV0],
            elastic.MA: gains[elastic.PM0],
            elastic.CA1: gains[elastic.PX1],
            elastic.VA1: gains[elastic.PV1],
            elastic.MA1: gains[elastic.PM1],
        }
    return tail, gains


def _lost(
    y: float, omega_c: float, s: complex, drive: complex, h: float, to_y: np.ndarray
) -> np.ndarray:
    """Y times the integral of y''^2 over a step: coefficients by z at the end without force, F_0
    and F_1, upper triangle row by row."""
    count = _NODES + math.ceil(_NODES_PER_RADIAN * max(abs(s) * h - math.pi, 0.0))
    nodes, weights = gauss(count)
    t, weights = 0.5 * h * (nodes + 1.0), 0.5 * h * weights
    one, two = phi(1, s * t), phi(2, s * t)
    back = np.exp(s * (t - h))
    rise = 2.0 * t / h - 1.0
    z = np.stack([back, 1j * back, drive * t * one, drive * t * (2.0 * t / h * two - one)])
    force = np.stack([np.zeros_like(t), np.zeros_like(t), np.ones_like(t), rise])
    value, rate = (row[0] * z.real + row[1] * z.imag for row in to_y)
    bend = force - 0.5 * math.pi * omega_c * rate - 3.0 * omega_c**2 * value
    full = y * (bend * weights) @ bend.T
    upper = np.triu(full) + np.triu(full, 1)
    return np.asarray(upper[np.triu_indices(4)])
