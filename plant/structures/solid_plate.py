"""Rectangular plate as an elastic solid: the modes of three-dimensional elasticity.

Edges hold the deflection and the motion along them and let the normal stress be zero, which
sin sin across with cos sin in the plane fulfils exactly (Srinivas, Rao and Rao 1970): every
k_mn = pi sqrt((m/l_x)^2 + (n/l_y)^2) has its own Rayleigh-Lamb branches, of which the faces move by
sqrt(P_b). Waves that shear in the plane alone do not move a face.

A contact's Hertz law holds the flexibility of a half space. It is taken off that of the modes left
out, so that it counts once; what is left is below zero, for the modes taken along hold a part
of the half space as well. Contact and actuator are on the same face.
"""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import scipy

from hertzloop.plant.one_thread import on_one_thread
from hertzloop.plant.structures.modes import Modes, Point
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.registry import Description
from hertzloop.plant.structures.structure import SizedPlate

# Largest wave number times contact radius: from pi/2 on the contact in series with what is left of
# the modes left out is no longer monotone. A law may press four times deeper.
_WIDEST = 0.25 * math.pi
_COUNTED = 2000  # wave numbers at which branches are counted
_ORDER = 12
HIGHEST = 20.0  # w h/c_T of the table
LONGEST = 24.0  # k h of the table; beyond it a layer is a half space
_ABSCISSAE = 1200
_THIN = 0.08  # k h below which rounding spoils A0, and a series takes its place
_FITTED = 0.24  # k h up to which that series is fitted


# Rayleigh-Lamb branches of an elastic layer: waves in a plate with thickness, free on both faces.
#
# At a wave number k the motion in plane U(z) and across W(z) of a layer of thickness h makes pairs
# of frequency and shape; over k they form branches, of which A0 is bending. In units of h, c_T and
# the density they depend on k h and Poisson's ratio alone, so each ratio has one table. Energies
# per area: potential 1/2 int (lambda + 2 mu)(k^2 U^2 + W'^2) - 2 lambda k U W' + mu (U' + k W)^2
# dz, kinetic 1/2 rho int (U^2 + W^2) w^2 dz; solved on half the thickness by one finite element of
# order 12 for each of the two families, antisymmetric (U = 0 in the middle plane) and symmetric
# (W = 0).


@dataclass(frozen=True)
class Branches:
    """All branches of a Poisson ratio with frequencies up to HIGHEST somewhere, by k h = x.

    `thin`: w h/c_T = thin x^2 of Kirchhoff's plate, `bending_over_thin`: A0's frequency over that;
    `others`: w h/c_T of the other branches; `participation`: P rho h of all, A0 first, the squared
    motion of a face over the mass per area that moves with it. `static`: sum P/w^2 of all branches
    in units of h/mu at the abscissae `x`, what one face gives way under a load on it; `rest`: the
    integrals of x sum P/w^n, n = 2 and 4, over the branches that are not here and, for all, what is
    beyond LONGEST; the first less a half space's.
    """

    thin: float
    bending_over_thin: Any
    others: tuple[Any, ...]
    participation: tuple[Any, ...]
    x: np.ndarray
    static: np.ndarray
    rest: tuple[float, float]

    def omegas(self, x: np.ndarray) -> np.ndarray:
        """w h/c_T of every branch at k h, (branches, points)."""
        bending = self.thin * x * x * self.bending_over_thin(x)
        return np.stack([bending, *(branch(x) for branch in self.others)])

    def weights(self, x: np.ndarray) -> np.ndarray:
        """P rho h of every branch at k h, (branches, points), never below zero."""
        return np.maximum(np.stack([branch(x) for branch in self.participation]), 0.0)

    def bending_x(self, omega: float) -> float:
        """k h of A0 at w h/c_T, the largest of all branches."""
        return float(
            scipy.optimize.brentq(
                lambda x: self.thin * x * x * self.bending_over_thin(x) - omega, 0.0, LONGEST
            )
        )

    def left_out(self, omega_c: float) -> tuple[float, float]:
        """Flexibility at a point of an infinite layer of all branches above w h/c_T = `omega_c`,
        without that of a half space, which Hertz's contact holds, in units of 1/(mu h); and what
        their inertia adds to it per squared w h/c_T.

        1/(2 pi) times the integral over x of x sum P/w^n, n = 2 less the half space's 1 - nu, and
        n = 4. The flexibility is below zero: the modes up to `omega_c` hold a part of the half
        space. Raises ValueError beyond HIGHEST.
        """
        if not omega_c <= HIGHEST:
            raise ValueError(f"w h/c_T = {omega_c:.3g} is beyond the {HIGHEST:g} of the branches")
        parts = [(0, self.bending_x(omega_c), LONGEST)]
        for b, branch in enumerate(self.others, 1):
            ends = np.concatenate(
                [[self.x[0]], branch.solve(omega_c, extrapolate=False), [LONGEST]]
            )
            parts += [
                (b, float(start), float(end))
                for start, end in pairwise(ends)
                if branch(0.5 * (start + end)) >= omega_c
            ]
        static, inertia = (
            (rest + sum(self._integral(n, *part) for part in parts)) / (2.0 * math.pi)
            for n, rest in zip((2, 4), self.rest, strict=True)
        )
        return static, inertia

    def _integral(self, n: int, b: int, start: float, end: float) -> float:
        """Of x P/w^n of a branch."""

        def integrand(x: float) -> float:
            weight = float(self.participation[b](x))
            if b:
                return x * weight / float(self.others[b - 1](x)) ** n
            return x * weight / (self.thin * x * x * float(self.bending_over_thin(x))) ** n

        return float(scipy.integrate.quad(integrand, start, end, epsrel=1e-6, limit=200)[0])


@lru_cache(maxsize=16)
def branches(poisson_ratio: float) -> Branches:
    """The table of a Poisson ratio; takes half a second."""
    nu = poisson_ratio
    x = np.linspace(math.sqrt(0.02), math.sqrt(LONGEST), _ABSCISSAE) ** 2
    families = [_solved(x, nu, held) for held in (0, _ORDER + 1)]  # U or W of the middle plane
    omega, weight = (np.concatenate([f[i] for f in families], axis=1).T for i in (0, 1))
    kept = np.flatnonzero(omega.min(axis=1) <= HIGHEST)
    thin = math.sqrt(1.0 / (6.0 * (1.0 - nu)))
    ratio = omega[0] / (thin * x * x)
    # A0 is even in k h: 1 + a x^2 + b x^4 below where it is known to rounding.
    known = (x >= _THIN) & (x <= _FITTED)
    series = np.polynomial.Polynomial.fit(x[known] ** 2, (ratio[known] - 1.0) / x[known] ** 2, 2)
    at = np.concatenate([np.linspace(0.0, _THIN, 9)[:-1], x[x >= _THIN]])
    low = at < _THIN
    values = np.concatenate([1.0 + at[low] ** 2 * series(at[low] ** 2), ratio[x >= _THIN]])
    gone = np.delete(np.arange(len(weight)), kept)
    rest = []
    for n, less in ((2, 1.0 - nu), (4, 0.0)):
        density = x * weight / omega**n
        within = scipy.interpolate.CubicSpline(
            np.append(0.0, x), np.append(-less, density[gone].sum(axis=0) - less)
        )
        # A half space's densities fall as x^(2 - n).
        beyond = LONGEST * density[:, -1].sum() / (n - 3) if n > 2 else 0.0
        rest.append(float(within.integrate(0.0, LONGEST)) + float(beyond))
    return Branches(
        thin=thin,
        bending_over_thin=scipy.interpolate.CubicSpline(at, values),
        others=tuple(scipy.interpolate.CubicSpline(x, omega[b]) for b in kept[1:]),
        participation=tuple(_monotone(x, weight[b], b == 0) for b in kept),
        x=x,
        static=np.sum(weight / omega**2, axis=0),
        rest=(rest[0], rest[1]),
    )


def _monotone(x: np.ndarray, weight: np.ndarray, bending: bool) -> Any:
    """Participation between abscissae without overshoot: 1 for A0 and 0 for all others at k = 0."""
    return scipy.interpolate.PchipInterpolator(
        np.append(0.0, x), np.append(1.0 if bending else 0.0, weight)
    )


@on_one_thread
def _solved(x: np.ndarray, nu: float, held: int) -> tuple[np.ndarray, np.ndarray]:
    """w h/c_T and P rho h of a family's branches at k h, (points, branches).

    Half a layer of thickness 1, mu = rho = 1; unknowns U then W at the nodes from the middle plane,
    where one of them, `held`, is zero, to the face; the last is W of the face.
    """
    value, slope, by = _shapes()
    lame, n = 2.0 * nu / (1.0 - 2.0 * nu), _ORDER + 1
    both, bent, mixed = (
        (a * by) @ b.T for a, b in ((value, value), (slope, slope), (value, slope))
    )
    zero = np.zeros_like(both)
    free = np.delete(np.arange(2 * n), held)

    def matrix(uu: np.ndarray, ww: np.ndarray, uw: np.ndarray) -> np.ndarray:
        return np.block([[uu, uw], [uw.T, ww]])[np.ix_(free, free)]

    fixed = matrix(bent, (lame + 2.0) * bent, zero)
    linear = matrix(zero, zero, mixed.T - lame * mixed)
    square = matrix((lame + 2.0) * both, both, zero)
    inverse = np.linalg.inv(np.linalg.cholesky(matrix(both, both, zero)))
    fixed, linear, square = (inverse @ m @ inverse.T for m in (fixed, linear, square))
    at = x[:, None, None]
    squared, shapes = np.linalg.eigh(fixed + at * linear + at * at * square)
    face = np.einsum("i,pib->pb", inverse[:, -1], shapes)
    # The modal mass of this half is 1; the other half moves as well.
    return np.sqrt(np.maximum(squared, 0.0)), 0.5 * face**2


@lru_cache(maxsize=1)
@on_one_thread
def _shapes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lagrange's polynomials on Gauss-Lobatto nodes of 0..1/2 and their slopes at Gauss's points,
    (nodes, points), and the weights."""
    legendre = np.polynomial.Legendre.basis(_ORDER)
    nodes = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    points, by = np.polynomial.legendre.leggauss(_ORDER + 2)
    # By Legendre's polynomials: the Vandermonde matrix of powers would lose digits.
    inverse = np.linalg.inv(np.polynomial.legendre.legvander(nodes, _ORDER))
    value = (np.polynomial.legendre.legvander(points, _ORDER) @ inverse).T
    derivatives = np.stack(
        [np.polynomial.Legendre.basis(n).deriv()(points) for n in range(_ORDER + 1)], axis=1
    )
    return value, (derivatives @ inverse).T * 4.0, by * 0.25


@lru_cache(maxsize=64)
def _left_out(poisson_ratio: float, omega_c: float) -> tuple[float, float]:
    return branches(poisson_ratio).left_out(omega_c)


@dataclass(frozen=True)
class SolidPlate(SizedPlate):
    """A simply supported plate with thickness; sizes and material are those of `plate`."""

    solid = True

    @cached_property
    def highest_hz(self) -> float:  # type: ignore[override]  # a constant in other structures
        """Frequency up to which the branches are known, Hz."""
        below = (1.0 - 1e-12) * HIGHEST  # whatever the rounding
        return below * self.unit_rad_s / (2.0 * math.pi)

    def __str__(self) -> str:
        return "a simply supported plate in three dimensions"

    @property
    def unit_rad_s(self) -> float:
        """c_T/h, in which the branches count frequencies, rad/s."""
        return self.material.shear_speed_m_s / self.plate.thickness_m

    def wave_number_1_m(self, omega: float) -> float:
        """Largest wave number of any branch at a frequency, 1/m."""
        return self._branches.bending_x(omega / self.unit_rad_s) / self.plate.thickness_m

    def frequency_hz(self, wave_number_1_m: float) -> float:
        """Frequency of A0 at a wave number, Hz; at most `highest_hz`."""
        x = np.array([wave_number_1_m * self.plate.thickness_m])
        bending = float(self._branches.omegas(np.minimum(x, LONGEST))[0, 0])
        return min(bending * self.unit_rad_s / (2.0 * math.pi), self.highest_hz)

    @property
    def simply_supported(self) -> Plate:
        """The thin plate of the same sizes; waves as short as sound are long in it."""
        return self.plate

    def contact_limit_hz(self, radius_m: float) -> float:
        """Up to where waves are long against a contact of this radius, Hz."""
        return self.frequency_hz(_WIDEST / radius_m)

    def modes_below(self, frequency_hz: float) -> float:
        """About how many modes there are up to a frequency, those of all branches, by the area of
        the wave numbers that each has there."""
        limit = 2.0 * math.pi * frequency_hz / self.unit_rad_s
        squared = np.linspace(0.0, self._branches.bending_x(min(limit, HIGHEST)) ** 2, _COUNTED)
        squared = 0.5 * (squared[1:] + squared[:-1])
        below = self._branches.omegas(np.sqrt(squared)) <= limit
        area = self.size_m[0] * self.size_m[1] / self.plate.thickness_m**2
        return float(area * squared[-1] * np.mean(np.sum(below, axis=0)) / (4.0 * math.pi))

    def modes(self, omega_max: float, contact_m: Point, actuator_m: Point) -> Modes:
        """All modes up to `omega_max` rad/s, by rising frequency. Raises ValueError beyond what the
        branches hold."""
        m, n, omega, face = self._numbers(omega_max)
        shapes = [face * self.plate.mode_shape(m, n, point) for point in (contact_m, actuator_m)]
        # pyrefly: ignore[bad-argument-type]
        return Modes(omega, self.plate.eta, self.plate.modal_scale_per_kg, *shapes)

    def residual_flexibility_m_n(self, omega_max: float, point_m: Point | None = None) -> float:
        """Static flexibility of all modes above `omega_max` without a half space's, m/N, below
        zero for all but the lowest limits: that of an infinite plate. Without a point: about how
        much what is left out moves, that of the thin plate."""
        if point_m is None:
            return self.plate.residual_flexibility_m_n(omega_max)
        unit = 1.0 / (self.material.shear_modulus_pa * self.plate.thickness_m)
        return unit * _left_out(self.material.poisson_ratio, omega_max / self.unit_rad_s)[0]

    def residual_inertia_m_n(self, omega_max: float, omega: float) -> float:
        """By how much the inertia of all modes above `omega_max` adds to their flexibility at a
        lower frequency `omega`, m/N."""
        unit = 1.0 / (self.material.shear_modulus_pa * self.plate.thickness_m)
        inertia = _left_out(self.material.poisson_ratio, omega_max / self.unit_rad_s)[1]
        return unit * inertia * (omega / self.unit_rad_s) ** 2

    def on_grid(self, omega_max: float, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Shapes of the face with the contact of all modes up to `omega_max`, (modes, x, y)."""
        m, n, _, face = self._numbers(omega_max)
        return np.asarray(face[:, None, None] * self.plate.shapes_on(m, n, x_m, y_m))

    @property
    def _branches(self) -> Branches:
        return branches(self.material.poisson_ratio)

    def _numbers(self, omega_max: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """m, n, frequency (rad/s) and sqrt(P rho h) of all modes up to a frequency, rising."""
        limit = omega_max / self.unit_rad_s
        if not limit <= HIGHEST:
            raise ValueError(
                f"modes in three dimensions are known up to {self.highest_hz:.3g} Hz, not to "
                f"{omega_max / (2.0 * math.pi):.3g} Hz"
            )
        lx, ly = self.size_m
        k_max = self.wave_number_1_m(omega_max)
        m_max, n_max = (max(1, math.floor(k_max * length / math.pi)) for length in (lx, ly))
        m, n = (a.ravel() for a in np.meshgrid(np.arange(1, m_max + 1), np.arange(1, n_max + 1)))
        k = np.sqrt((m * np.pi / lx) ** 2 + (n * np.pi / ly) ** 2)
        near = k <= k_max * (1.0 + 1e-9)
        m, n, x = m[near], n[near], k[near] * self.plate.thickness_m
        omega, weight = self._branches.omegas(x), self._branches.weights(x)
        branch, mode = np.nonzero(omega <= limit)
        order = np.argsort(omega[branch, mode], kind="stable")
        branch, mode = branch[order], mode[order]
        return (
            m[mode],
            n[mode],
            omega[branch, mode] * self.unit_rad_s,
            np.sqrt(weight[branch, mode]),
        )


def made(description: Description) -> SolidPlate:
    """The plate by its sizes."""
    return SolidPlate(description.thin_plate)
