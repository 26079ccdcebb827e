"""All closed-loop poles of a sampled loop with delay, by Aberth's method on 1 + L.

A polynomial of the loop would lose all digits: plant poles crowd at Z = 1. The secular equation
does not (O. Aberth, Math. Comp. 27 (1973) 339). With the open-loop poles p, the function
F(Z) = (1 + L(Z)) times the product of (Z - p) has the closed-loop poles as its zeros, and F'/F
needs no coefficients. Poles that the loop moves by no more than rounding are set aside at the
start.
"""

import numpy as np

from hertzloop.studies.margin.law_filters import LawFilter
from hertzloop.studies.margin.linear import PoleForm
from hertzloop.studies.margin.sums_kernels import pole_sums

_ROUNDS, _PATIENCE = 80, 25
_ROUNDINGS = (1e-15, 1e-12, 1e-10)  # lengths of a last step, each for so many rounds
_NO_SHIFT = 1e-15
_TWINS = 4e-16  # distance of poles that are the same
_MOST_SHIFT, _BESIDE = 0.05, 1e-4  # starts: beside a pole of the plant at most, and of the law
# Starts of two conjugate poles are no conjugates, which could never become two real poles.
_TURN = np.exp(0.1j)
_AT_ZERO = 1e-7  # a zero of the law at 0 leaves a pole there, which means nothing
_LARGEST = 300.0  # logarithm of the largest power of Z
MOST_STATES = 10_000  # up to which closed-loop poles are computed, in some seconds at most


def states_of(plant: PoleForm, law: LawFilter, delay: int) -> int:
    """Return the number of states of a loop: poles of plant and law, and delayed samples."""
    late = delay + int(np.max(np.flatnonzero(plant.fir), initial=-1)) + 1 + len(law.taps)
    return 2 * len(plant.poles) + len(law.poles) + late


def closed_loop_poles(plant: PoleForm, law: LawFilter, delay: int) -> np.ndarray | None:
    """Return all closed-loop poles but those at zero, both of each conjugate pair; None if there
    are too many states, or if the method fails.

    Args:
        plant: response from command to sample.
        law: response from sample to command.
        delay: of the command, in samples, beyond the one that `plant` holds.
    """
    if states_of(plant, law, delay) > MOST_STATES:
        return None
    poles, residues, twins = _merged(*plant.both_of_pairs())
    # A finite impulse response is a delay too: its poles are at zero, to the last digit.
    control = np.asarray(law.poles, complex)
    control = control[control != 0.0]
    late = delay + int(np.max(np.flatnonzero(plant.fir), initial=-1)) + 1
    late += len(law.poles) - len(control) + len(law.taps)

    def rest(z: np.ndarray, skip: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The plant without some poles, its slope, and the sum of 1/(z - p)."""
        value, slope, inverse = sums_at(z, poles, residues, skip)
        value += (plant.fir[0] + plant.fir[1] / z) / z
        slope -= (plant.fir[0] + 2.0 * plant.fir[1] / z) / z**2
        return value, slope, inverse

    with np.errstate(all="ignore"):
        gain = law.at(poles)
        if not np.all(np.isfinite(gain)):
            return None
        # To first order, how far a pole of the plant moves when the loop is closed.
        without = rest(poles, np.arange(len(poles)))[0]
        shift = gain * residues / (_power(poles, delay) - gain * without)
        still = ~(np.abs(shift) > _NO_SHIFT)
        fixed, own = np.concatenate([twins, poles[still]]), poles[~still]
        moved = shift[~still]
        moved *= np.minimum(1.0, _MOST_SHIFT / np.abs(moved))
        scale = abs(complex(law.at(np.array([1j]))[0]) * complex(plant.at(np.array([1j]))[0]))
        radius = min(max(scale, 1e-12) ** (1.0 / late), 0.98) if late else 0.0
        ring = max(radius, 0.02) * np.exp(2j * np.pi * (np.arange(late) + 0.37) / max(late, 1))
        beside = control + _BESIDE * np.exp(1j * np.arange(len(control)))
        z = np.concatenate([own + moved * _TURN, beside, ring])
        poles, residues = own, residues[~still]
        moving = np.ones(len(z), bool)
        for i in range(_ROUNDS):
            at = np.flatnonzero(moving)
            if not len(at):
                break
            here = z[at]
            value, slope, by_plant = rest(here, np.full(len(at), -1))
            law_value, law_slope = law.with_slope(here)
            relative = law_slope / law_value + slope / value - delay / here  # L'/L
            other = -_power(here, delay) / (law_value * value)  # 1/L
            by_law = (1.0 / (here[:, None] - control)).sum(axis=1)
            total = relative / (1.0 + other) + by_plant + by_law + late / here
            around = sums_at(here, z, z, at)[2]
            change = 1.0 / (total - around)
            size = np.abs(change)
            finite = np.isfinite(size)  # where it is not, the zero is on a pole to the last digit
            z[at] -= np.where(finite, change, 0.0)
            # A zero of poor condition turns about in its own rounding.
            tolerance = _ROUNDINGS[min(i // _PATIENCE, len(_ROUNDINGS) - 1)]
            moving[at] = finite & (size > tolerance) & (np.abs(z[at]) > _AT_ZERO)
    if moving.any() or not np.all(np.isfinite(z)):
        return None
    return np.concatenate([fixed, z[np.abs(z) > _AT_ZERO]])


def sums_at(
    z: np.ndarray, poles: np.ndarray, residues: np.ndarray, skip: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the sums of r/(z - p), of -r/(z - p)^2 and of 1/(z - p) over poles p.

    Args:
        z: points, complex, shape (n,).
        poles, residues: complex, shape (poles,).
        skip: number of the pole that a point leaves out, else -1, shape (n,).
    """
    parts = [part.copy() for one in (z, poles, residues) for part in (one.real, one.imag)]
    found = np.empty((6, len(z)))
    pole_sums(*parts, skip, found)
    return found[0] + 1j * found[1], found[2] + 1j * found[3], found[4] + 1j * found[5]


def _power(z: np.ndarray, n: int) -> np.ndarray:
    """Return z^n, which stays finite."""
    exponent = n * np.log(z)
    return np.exp(np.minimum(exponent.real, _LARGEST) + 1j * exponent.imag)


def _merged(poles: np.ndarray, residues: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return poles without twins, their summed residues, and the twins, which no loop moves."""
    order = np.lexsort((poles.imag, poles.real))
    poles, residues = poles[order], residues[order]
    apart = np.append(True, np.abs(np.diff(poles)) > _TWINS)
    first = np.flatnonzero(apart)
    return poles[apart], np.add.reduceat(residues, first), poles[~apart]
