"""All closed-loop poles of a sampled loop with delay, by Aberth's method on 1 + L.

A polynomial of the loop would lose all digits: plant poles crowd at Z = 1. The secular equation
does not (O. Aberth, Math. Comp. 27 (1973) 339). Poles that the loop moves by no more than rounding
are set aside at the start.
"""

import numpy as np

from hertzloop.studies.margin import sums_kernels
from hertzloop.studies.margin.law_filters import LawFilter
from hertzloop.studies.margin.linear import PoleForm

_ROUNDS, _PATIENCE = 80, 25
_ROUNDINGS = (1e-15, 1e-12, 1e-10)  # lengths of a last step, each for so many rounds
_NO_SHIFT = 1e-15
_TWINS = 4e-16  # distance of poles that are the same
_MOST_SHIFT = 0.05
MOST_STATES = 6000  # up to which all closed-loop poles are computed, in a second or less


def closed_loop_poles(plant: PoleForm, law: LawFilter, delay: int) -> np.ndarray | None:
    """Return all closed-loop poles, both of each conjugate pair; None if the method fails.

    Args:
        plant: response from command to sample.
        law: response from sample to command.
        delay: of the command, in samples, beyond the one that `plant` holds.
    """
    if law.factored:
        return _by_response(plant, law, delay)
    poles, residues, twins = _merged(*plant.both_of_pairs())
    own, own_residues = np.asarray(law.poles, complex), np.asarray(law.residues, complex)
    taps = 2 if plant.fir[1] else 1 if plant.fir[0] else 0
    n, m = len(poles), len(own)
    at = np.concatenate([poles, own])
    which = np.arange(n + m)
    shift = np.empty(n + m, complex)
    rows, own_rows = _rows(poles, residues), _rows(own, own_residues)
    filters = np.concatenate([[law.direct], law.taps])
    if not (np.all(np.isfinite(own_residues)) and np.all(np.isfinite(filters))):
        return None  # a law without partial fractions
    sums_kernels.shifts(
        at,
        np.where(which < n, which, -1),
        np.where(which >= n, which - n, -1),
        rows,
        own_rows,
        plant.fir,
        filters,
        delay,
        shift,
    )
    still = np.abs(shift) <= _NO_SHIFT
    fixed = np.concatenate([twins, at[still]])
    moving = at[~still] + shift[~still] * np.minimum(1.0, _MOST_SHIFT / np.abs(shift[~still]))
    late = delay + taps + len(law.taps)
    ring = np.exp(2j * np.pi * (np.arange(late) + 0.37) / max(late, 1))
    scale = abs(complex(law.at(np.array([1j]))[0]) * complex(plant.at(np.array([1j]))[0]))
    radius = min(max(scale, 1e-12) ** (1.0 / late), 0.98) if late else 0.0
    z = np.concatenate([moving, max(radius, 0.02) * ring])
    z_re, z_im, done = z.real.copy(), z.imag.copy(), np.zeros(len(z), bool)
    rows, own_rows = rows[:, ~still[:n]].copy(), own_rows[:, ~still[n:]].copy()
    for i in range(_ROUNDS):
        # A zero of poor condition turns about in its own rounding.
        tolerance = _ROUNDINGS[min(i // _PATIENCE, len(_ROUNDINGS) - 1)]
        if not sums_kernels.aberth_round(
            z_re, z_im, rows, own_rows, plant.fir, filters, delay, late, done, tolerance
        ):
            found = np.concatenate([fixed, z_re + 1j * z_im])
            return found if np.all(np.isfinite(found)) else None
    return None


def _merged(poles: np.ndarray, residues: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return poles without twins, their summed residues, and the twins, which no loop moves."""
    order = np.lexsort((poles.imag, poles.real))
    poles, residues = poles[order], residues[order]
    apart = np.append(True, np.abs(np.diff(poles)) > _TWINS)
    first = np.flatnonzero(apart)
    return poles[apart], np.add.reduceat(residues, first), poles[~apart]


def _rows(poles: np.ndarray, residues: np.ndarray) -> np.ndarray:
    return np.array([poles.real, poles.imag, residues.real, residues.imag]).reshape(4, -1)


_MOST_POLES = 4000
_CONVERGED = 1e-13
_HARDLY = 1e-15  # a pole whose residue is smaller than this does not move
_AT_ZERO = 1e-7
_NUDGE = 1e-6  # start beside an open-loop pole, where the loop gain is infinite


def _by_response(plant: PoleForm, law: LawFilter, delay: int) -> np.ndarray | None:
    """Return all closed-loop poles but those at zero, with a law that is a product of stages;
    its response and slope are enough.

    F(Z) = (1 + L(Z)) times the product of (Z - p) over all open-loop poles p has the closed-loop
    poles as its zeros, and F'/F needs no coefficients.
    """
    own, residues = plant.both_of_pairs()
    # A finite impulse response is a delay too: its poles are at zero, to the last digit.
    control_poles = law.poles[law.poles != 0.0]
    late = delay + int(np.max(np.flatnonzero(plant.fir), initial=-1)) + 1
    late += len(law.poles) - len(control_poles)
    if len(own) + len(control_poles) + late > _MOST_POLES:
        return None
    pull = residues * law.at(own) * own ** -float(delay)  # how far a small gain moves a pole
    moves = np.abs(pull) > _HARDLY
    fixed, own, residues, pull = own[~moves], own[moves], residues[moves], pull[moves]
    open_loop = np.concatenate([own, control_poles, np.zeros(late)])

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
    turned = np.exp(1j * np.arange(len(control_poles)))
    z = np.concatenate([own + step, control_poles + 1e-4 * turned, round_zero])
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
