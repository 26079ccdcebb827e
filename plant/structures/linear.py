"""A linear structure: poles, forces that drive them, points that see them.

Everything linear is z' = s z + B F for every pole s, and a point moves by the real part of C z. The
poles are complex: one of each conjugate pair stands for an oscillator. `Linear` is the same
structure in discrete time, under forces F(t) = F_0 + F_1 (2 t/h - 1) in each step; the step of the
plant, margins, exports and pictures read it. `plant.schemes.modal.poles_of` builds the poles of a
plant.

    q'' + 2 delta q' + w^2 q = lambda b_F F, moving a point by b q, is the pole s = -delta + j theta
    with B = lambda b_F, C = -j b/theta, theta^2 = w^2 - delta^2; then z = q' + delta q + j theta q.
    With another scale of z it is the same structure: B times a number, C by it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hertzloop.common.elementary_kernels import exp, sine_and_cosine
from hertzloop.common.jit import kernel
from hertzloop.plant.lanes import LANES, aligned

# Indices of what is seen of a point: displacement (m), velocity (m/s), mean displacement of a step.
X, V, MEAN = range(3)
RE, IM = range(2)
_SERIES_TERMS = 24  # 1/24! is below rounding for |x| <= 1


@dataclass(frozen=True, eq=False)
class Poles:
    """A structure in continuous time.

    Attributes:
        poles: s, 1/s, complex, shape (n,).
        drive: B of every force, shape (forces, n), complex.
        see: C of every point, shape (points, n), complex.
        energy: what a pole keeps, J: energy[0] (Re z)^2 + energy[1] Re z Im z + energy[2] (Im z)^2,
            shape (3, n).
    """

    poles: np.ndarray
    drive: np.ndarray
    see: np.ndarray
    energy: np.ndarray

    def direct(self) -> np.ndarray:
        """Velocity of every point that follows a force at once, m/(N s), shape (points, forces)."""
        found = [[np.sum(c * b).real for b in self.drive] for c in self.see]
        return np.array(found).reshape(len(self.see), len(self.drive))


class Linear(NamedTuple):
    """A structure from step to step; n is a multiple of eight, the rest are zeros.

    Attributes:
        turn: e^(s h), shape (2, n): real and imaginary parts.
        drive: change of z by F_0 and by F_1 of every force, shape (forces, 2, 2, n).
        see: factors of Re z and Im z in displacement and velocity of every point at the end of a
            step, and in its mean displacement by z at the end; shape (points, 3, 2, n).
        gain: what F_0 and F_1 of a force do to a point within their own step, shape
            (points, 3, forces, 2). Its velocity is without `direct`.
        direct: velocity that follows a force at once, m/(N s), shape (points, forces).
        energy: see `Poles`, shape (3, n).
    """

    turn: np.ndarray
    drive: np.ndarray
    see: np.ndarray
    gain: np.ndarray
    direct: np.ndarray
    energy: np.ndarray


@kernel
def phis(x):
    """phi_0 to phi_3 of a complex number, phi_k the sum of x^i/(i + k)!, to rounding also near
    zero."""
    size = exp(x.real)
    sine, cosine = sine_and_cosine(x.imag)
    zero = complex(size * cosine, size * sine)
    if abs(x.real) + abs(x.imag) > 1.0:
        one = (zero - 1.0) / x
        two = (one - 1.0) / x
        return zero, one, two, (two - 0.5) / x
    term = complex(1.0 / 6.0, 0.0)
    three = term
    for i in range(1, _SERIES_TERMS):
        term = term * x / (i + 3)
        three += term
    two = 0.5 + x * three
    return zero, 1.0 + x * two, two, three


@kernel
def _fill(poles, drive, see, step_s, linear):
    """Write the coefficients of a step into the arrays of `linear`, all zeros before.

    With x = s h, drive = B h phi_1 and B h x (2 phi_3 - phi_2), the integrals of e^(s (h - t)) B
    times 1 and P = 2 t/h - 1; their means over the step are B h phi_2 and B h (2 phi_3 - phi_2).
    see = C, C s and C phi_1(-x), the mean of e^(s (t - h)) C. gain = Re(C drive), Re(C s drive),
    Re(C mean).
    """
    h = step_s
    for n in range(poles.size):
        s = poles[n]
        x = s * h
        turn, one, two, three = phis(x)
        rise = 2.0 * three - two
        held, risen = h * one, h * (x * rise)
        mean_held, mean_risen = h * two, h * rise
        mean_by_end = phis(-x)[1]
        linear.turn[RE, n] = turn.real
        linear.turn[IM, n] = turn.imag
        for force in range(drive.shape[0]):
            by_0, by_1 = drive[force, n] * held, drive[force, n] * risen
            linear.drive[force, 0, RE, n] = by_0.real
            linear.drive[force, 0, IM, n] = by_0.imag
            linear.drive[force, 1, RE, n] = by_1.real
            linear.drive[force, 1, IM, n] = by_1.imag
            mean_0, mean_1 = drive[force, n] * mean_held, drive[force, n] * mean_risen
            for point in range(see.shape[0]):
                c = see[point, n]
                speed = c * s
                linear.gain[point, X, force, 0] += (c * by_0).real
                linear.gain[point, X, force, 1] += (c * by_1).real
                linear.gain[point, V, force, 0] += (speed * by_0).real
                linear.gain[point, V, force, 1] += (speed * by_1).real
                linear.gain[point, MEAN, force, 0] += (c * mean_0).real
                linear.gain[point, MEAN, force, 1] += (c * mean_1).real
        for point in range(see.shape[0]):
            c = see[point, n]
            speed, mean = c * s, c * mean_by_end
            linear.see[point, X, RE, n] = c.real
            linear.see[point, X, IM, n] = -c.imag
            linear.see[point, V, RE, n] = speed.real
            linear.see[point, V, IM, n] = -speed.imag
            linear.see[point, MEAN, RE, n] = mean.real
            linear.see[point, MEAN, IM, n] = -mean.imag


def linear_of(structure: Poles, step_s: float) -> Linear:
    """The structure from step to step, `step_s` (s) apart."""
    forces, points, poles = len(structure.drive), len(structure.see), len(structure.poles)
    n = -(-poles // LANES) * LANES
    linear = Linear(
        turn=aligned(np.zeros((2, n))),
        drive=aligned(np.zeros((forces, 2, 2, n))),
        see=aligned(np.zeros((points, 3, 2, n))),
        gain=np.zeros((points, 3, forces, 2)),
        direct=structure.direct(),
        energy=np.zeros((3, n)),
    )
    linear.energy[:, :poles] = structure.energy
    _fill(structure.poles, structure.drive, structure.see, step_s, linear)
    return linear


@kernel
def deflections(linear, z, forces, first, frames, found):
    """Step the poles through a block of forces, and note what they displace at some steps.

    Args:
        linear: the structure.
        z: of the poles at the start of the block, with all forces until then, (2, n); at its end
            afterwards.
        forces: F_0 and F_1 of every force and step, (2 forces, steps).
        first: number of the block's first step.
        frames: steps to note, ascending, those of the block alone.
        found: room for -Re(j z) of every pole there, (frames, n).
    """
    at = 0
    for i in range(forces.shape[1]):
        while at < frames.size and frames[at] == first + i:
            for n in range(z.shape[1]):
                found[at, n] = z[IM, n]
            at += 1
        for n in range(z.shape[1]):
            re, im = z[RE, n], z[IM, n]
            z[RE, n] = linear.turn[RE, n] * re - linear.turn[IM, n] * im
            z[IM, n] = linear.turn[RE, n] * im + linear.turn[IM, n] * re
        for force in range(linear.drive.shape[0]):
            f0, f1 = forces[2 * force, i], forces[2 * force + 1, i]
            if f0 == 0.0 and f1 == 0.0:
                continue
            by = linear.drive[force]
            for n in range(z.shape[1]):
                z[RE, n] += by[0, RE, n] * f0 + by[1, RE, n] * f1
                z[IM, n] += by[0, IM, n] * f0 + by[1, IM, n] * f1
