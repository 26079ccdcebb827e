"""All closed-loop poles of a sampled loop with delay, by Aberth's method on 1 + L.

A polynomial of the loop would lose all digits: plant poles crowd at Z = 1. The secular equation
does not. Poles that the loop moves by no more than rounding are set aside at the start.
"""

import numpy as np

from hertzloop.studies.margin import sums_kernels as k
from hertzloop.studies.margin.identify import LawFilter
from hertzloop.studies.margin.linear import PoleForm

_ROUNDS, _PATIENCE = 80, 25
_ROUNDINGS = (1e-15, 1e-12, 1e-10)  # lengths of a last step, each for so many rounds
_NO_SHIFT = 1e-15
_TWINS = 4e-16  # distance of poles that are the same
_MOST_SHIFT = 0.05


def closed_loop_poles(plant: PoleForm, law: LawFilter, delay: int) -> np.ndarray | None:
    """Return all closed-loop poles, both of each conjugate pair; None if the method fails.

    Args:
        plant: response from command to sample.
        law: response from sample to command.
        delay: of the command, in samples, beyond the one that `plant` holds.
    """
    pair = plant.poles.imag != 0.0
    double = np.where(plant.poles.imag == 0.0, 2.0, 1.0)  # a real pole has half its residue
    poles = np.concatenate([plant.poles, plant.poles[pair].conj()])
    residues = np.concatenate([plant.residues * double, plant.residues[pair].conj()])
    poles, residues, twins = _merged(poles, residues)
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
    k.shifts(
        at, np.where(which < n, which, -1), np.where(which >= n, which - n, -1), rows, own_rows,
        plant.fir, filters, delay, shift,
    )  # fmt: skip
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
        if not k.aberth_round(
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
