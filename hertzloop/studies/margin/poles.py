"""All closed-loop poles of a sampled loop with delay, by Aberth's method on 1 + L.

A polynomial of the loop would lose all digits: plant poles crowd at Z = 1. The secular equation
does not (O. Aberth, Math. Comp. 27 (1973) 339). With the open-loop poles p, the function
F(Z) = (1 + L(Z)) times the product of (Z - p) has the closed-loop poles as its zeros, and F'/F
needs no coefficients. Poles that the loop moves by no more than rounding are set aside at the
start.
"""

import numpy as np

from hertzloop.studies.margin.linear import TransferFunction, sums_at

_ROUNDS, _PATIENCE = 80, 25
_ROUNDINGS = (1e-15, 1e-12, 1e-10)  # lengths of a last step, each for so many rounds
_NO_SHIFT = 1e-15
_TWINS = 4e-16  # distance of poles that are the same
_MOST_SHIFT, _BESIDE = 0.05, 1e-4  # starts: beside a pole of the plant at most, and of the law
# Starts of two conjugate poles are no conjugates, which could never become two real poles.
_TURN = np.exp(0.1j)
_AT_ZERO = 1e-7  # a zero of the law at 0 leaves a pole there, which means nothing
_LARGEST = 300.0  # logarithm of the largest power of Z
_MOST_STATES = 10_000  # up to which closed-loop poles are computed, in some seconds at most


def closed_loop_poles(
    plant: TransferFunction, law: TransferFunction, delay: int
) -> np.ndarray | None:
    """Return all closed-loop poles but those at zero, both of each conjugate pair; None if there
    are too many states, or if the method fails.

    Args:
        plant: response from command to sample.
        law: response from sample to command.
        delay: of the command, in samples, beyond the one that `plant` holds.
    """
    # A finite impulse response is a delay too: its poles are at zero, to the last digit.
    late = delay + int(np.max(np.flatnonzero(plant.fir), initial=0))
    late += int(np.sum(law.poles == 0.0)) + len(law.fir) - 1
    control = np.asarray(law.poles[law.poles != 0.0], complex)
    if len(plant.poles) + len(control) + late > _MOST_STATES:
        return None
    poles, residues, twins = _merged(plant.poles, plant.residues)

    with np.errstate(all="ignore"):
        gain = law.at(poles)
        if not np.all(np.isfinite(gain)):
            return None
        # To first order, how far a pole of the plant moves when the loop is closed.
        value, slope, _ = sums_at(poles, poles, residues, np.arange(len(poles)))
        without = plant.with_taps(poles, value, slope)[0]
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
            value, slope, by_plant = sums_at(here, poles, residues)
            value, slope = plant.with_taps(here, value, slope)
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
