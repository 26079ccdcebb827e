"""All closed-loop poles of a loop whose law is a product of stages, by Aberth's method.

It needs the law's response and its slope, but no partial fractions: those of a filter with crowded
poles have no digits left.

A polynomial would lose its digits, since the poles crowd at Z = 1. The function
F(Z) = (1 + L(Z)) times the product of (Z - p) over all open-loop poles p has the closed-loop poles
as its zeros, and F'/F needs no coefficients (Aberth 1973, Math. Comp. 27).
"""

import numpy as np

from hertzloop.studies.margin.identify import LawFilter
from hertzloop.studies.margin.linear import PoleForm

_MOST_POLES = 4000
_ROUNDS = 200
_CONVERGED = 1e-13
_HARDLY = 1e-15  # a pole whose residue is smaller than this does not move
_AT_ZERO = 1e-7
_NUDGE = 1e-6  # start beside an open-loop pole, where the loop gain is infinite


def product_poles(plant: PoleForm, law: LawFilter, delay: int) -> np.ndarray | None:
    """Return all closed-loop poles but those at zero, shape (n,); None if they are
    too many or do not converge.

    Args:
        plant: response from command to sample.
        law: response from sample to command.
        delay: of the command, whole samples.
    """
    paired = plant.poles.imag != 0.0
    own = np.concatenate([plant.poles, plant.poles[paired].conj()])
    residues = np.concatenate(
        [np.where(paired, plant.residues, 2.0 * plant.residues), plant.residues[paired].conj()]
    )
    late = delay + int(np.max(np.flatnonzero(plant.fir), initial=-1)) + 1
    if len(own) + len(law.poles) + late > _MOST_POLES:
        return None
    pull = residues * law.at(own) * own ** -float(delay)  # how far a small gain moves a pole
    moves = np.abs(pull) > _HARDLY
    fixed, own, residues, pull = own[~moves], own[moves], residues[moves], pull[moves]
    open_loop = np.concatenate([own, law.poles, np.zeros(late)])

    def response(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """L, and the derivative of log L."""
        apart = 1.0 / (z[:, None] - own)
        value = apart @ residues + plant.fir[0] / z + plant.fir[1] / z**2
        slope = -(apart**2) @ residues - plant.fir[0] / z**2 - 2.0 * plant.fir[1] / z**3
        control, change = law.with_slope(z)
        with np.errstate(over="ignore"):
            gain = -control * value * z ** -float(delay)
        return gain, slope / value + change / control - delay / z

    near = np.where(np.abs(pull) > 0.3 * np.abs(1.0 - np.abs(own)), 0.3, 1.0) * pull
    step = np.where(np.abs(near) < _NUDGE, near, _NUDGE * near / np.abs(near))
    radius = 0.6 ** (10.0 / max(late, 10))  # the roots of a long delay lie near the unit circle
    round_zero = radius * np.exp(2j * np.pi * (np.arange(late) + 0.37) / max(late, 1))
    turned = np.exp(1j * np.arange(len(law.poles)))
    z = np.concatenate([own + step, law.poles + 1e-4 * turned, round_zero])
    open_ = np.ones(len(z), bool)
    for _ in range(_ROUNDS):
        at = np.flatnonzero(open_)
        if not len(at):
            break
        with np.errstate(all="ignore"):
            gain, relative = response(z[at])
            inverse = relative / (1.0 + 1.0 / gain)  # of Newton's step on 1 + L
            apart = z[at, None] - open_loop
            inverse = inverse + (1.0 / np.where(apart == 0.0, _NUDGE, apart)).sum(axis=1)
            others = z[at, None] - z
            others[np.arange(len(at)), at] = np.inf
            inverse = inverse - (1.0 / np.where(others == 0.0, _NUDGE, others)).sum(axis=1)
            change = 1.0 / inverse
        change = np.where(np.isfinite(change), change, 0.0)
        size = np.abs(change)
        change = np.where(size > 0.1, 0.1 * change / np.maximum(size, 1e-300), change)
        z[at] -= change
        away = np.abs(z[at])  # a zero of the law at 0 leaves a pole there, which means nothing
        open_[at] = (size > _CONVERGED * np.maximum(away, 1e-3)) & (away > _AT_ZERO)
    return None if open_.any() else np.concatenate([z[np.abs(z) > _AT_ZERO], fixed])
