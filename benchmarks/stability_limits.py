"""Stability limits of the textbook integrators: predicted, and found by running their kernels.

Free vibration with and without damping, and the frequencies of a sphere and modes that a contact
joins.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np
from scipy.optimize import brentq

from benchmarks import integrator_kernels as ik
from benchmarks.integrators import Problem

Kernel = tuple[Callable[..., None], tuple[float, ...]]
TEXTBOOK: dict[str, Kernel] = {
    "verlet": (ik.verlet, ()),
    "rk4": (ik.rk4, ()),
    "newmark": (ik.alpha_method, (0.0,)),
    "hht": (ik.alpha_method, (-0.1,)),
}
# Explicit methods with damping, the loss factor as last argument. The implicit ones have no limit
# to lose, damped or not, and are left out.
DAMPED = {"verlet": ik.verlet, "verlet, lagged damping": ik.leapfrog_lagged, "rk4": ik.rk4}
LIMITS = {"verlet": 2.0, "rk4": 2.0 * math.sqrt(2.0)}  # of w h, for a free vibration
_FREE_STEPS = 400


def growth_per_step(scheme: str, phase: float, loss_factor: float = 0.0) -> float:
    """Factor by which a free vibration with w h = `phase` grows in a step: the largest
    eigenvalue of the step from (q, q'/w) to the next. Hilber-Hughes-Taylor's step has an
    acceleration of its own as well; there the growth over many steps is taken. Raises ValueError
    for a loss factor above zero with a scheme that is not in `DAMPED`."""
    kernel, more = TEXTBOOK[scheme] if scheme not in DAMPED else (DAMPED[scheme], (loss_factor,))
    if loss_factor > 0.0 and scheme not in DAMPED:
        raise ValueError(f"{scheme} is not among the damped schemes {list(DAMPED)}")

    def after(q: float, v: float, steps: int) -> np.ndarray:
        y = np.array([q, v * phase, 1e9, 0.0])  # the sphere is far away
        kernel(
            y,
            np.array([phase * phase]),
            np.array([1.0]),
            1.0,
            1.0,
            1.0,
            steps,
            1,
            np.empty(steps),
            *more,
        )
        return np.array([y[0], y[1] / phase])

    if scheme == "hht":
        size = float(np.linalg.norm(after(1.0, 0.0, _FREE_STEPS)))
        return size ** (1.0 / _FREE_STEPS)
    matrix = np.column_stack([after(1.0, 0.0, 1), after(0.0, 1.0, 1)])
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def growth(every: int = 1) -> Iterator[tuple[str, float, float]]:
    """Scheme, w h, growth per step; `every`: take each n-th step only."""
    for scheme in TEXTBOOK:
        for phase in np.arange(0.05, 4.0, 0.05)[::every]:
            yield scheme, float(phase), growth_per_step(scheme, float(phase))


def damped_limit(scheme: str, loss_factor: float) -> float:
    """Predicted limit of w h of a free vibration with delta = loss_factor w/2.

    Central differences: 2; with lagged damping: sqrt(4 + eta^2) - eta; Runge-Kutta: where
    |1 + z + z^2/2 + z^3/6 + z^4/24| = 1 for z = w h (-eta/2 + i sqrt(1 - eta^2/4)).
    """
    if scheme == "verlet":
        return 2.0
    if scheme == "verlet, lagged damping":
        return math.sqrt(4.0 + loss_factor**2) - loss_factor
    turn = complex(-0.5 * loss_factor, math.sqrt(1.0 - 0.25 * loss_factor**2))

    def beyond(phase: float) -> float:
        z = phase * turn
        return abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0)))) - 1.0

    return float(brentq(beyond, 2.0, 4.0, xtol=1e-13))


def measured_limit(scheme: str, loss_factor: float) -> float:
    """The same limit from the kernel's own step: where its growth passes 1, by bisection."""
    low, high = 0.5, 4.0
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        # An undamped Verlet neither grows nor decays inside; rounding must not count as growth.
        if growth_per_step(scheme, middle, loss_factor) > 1.0 + 1e-9:
            high = middle
        else:
            low = middle
    return low


def damped_limits(every: int = 1) -> Iterator[tuple[str, float, float, float]]:
    """Scheme, loss factor, predicted and measured limit of w h; `every`: each n-th loss factor."""
    for scheme in DAMPED:
        for eta in np.linspace(0.0, 1.0, 11)[::every]:
            predicted = damped_limit(scheme, float(eta))
            yield scheme, float(eta), predicted, measured_limit(scheme, float(eta))


def highest_frequency_rad_s(what: Problem, penetration_m: float) -> float:
    """Of sphere and modes joined by the contact's tangent spring 1.5 s sqrt(p), rad/s.

    With a_i = q_i/sqrt(d_i), b = sqrt(m) x_s the equations are symmetric: a diagonal of w^2 and
    the spring along g = (sqrt(d), -1/sqrt(m)).
    """
    spring = 1.5 * what.spec.contact.stiffness * math.sqrt(penetration_m)
    along = np.append(np.sqrt(what.drive), -1.0 / math.sqrt(what.spec.sphere.mass_kg))
    matrix = np.diag(np.append(what.omega2, 0.0)) + spring * np.outer(along, along)
    return math.sqrt(float(np.linalg.eigvalsh(matrix)[-1]))


def contact_frequency_rad_s(what: Problem, penetration_m: float) -> float:
    """sqrt(1.5 s sqrt(p)/m), m reduced of the sphere and all modes as free masses, rad/s."""
    spring = 1.5 * what.spec.contact.stiffness * math.sqrt(penetration_m)
    return math.sqrt(spring * (1.0 / what.spec.sphere.mass_kg + float(np.sum(what.drive))))
