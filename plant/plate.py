"""Simply supported rectangular plate: its modes, reduced to what a point force can move.

Kirchhoff theory, loss factor eta on every mode: q'' + eta w q' + w^2 q = lambda phi F,
with phi = sin(m pi x/l_x) sin(n pi y/l_y) and lambda = 4/(m'' l_x l_y).
"""

import math
from dataclasses import dataclass

import numpy as np

from plant.materials import Material

_SAME_FREQUENCY = 1e-12  # relative; phase error of merging stays below rounding of the sums
_NO_PARTICIPATION = 1e-9  # of the largest possible value 1
_ROUNDING = 1e-12  # of a squared length
_TAIL = 16.0  # modes left out are summed one by one up to this multiple of the limit


@dataclass(frozen=True)
class Plate:
    """Rectangular plate, sizes in m; `loss_factor` replaces the material's if given."""

    material: Material
    size_m: tuple[float, float]
    thickness_m: float
    loss_factor: float | None = None

    @property
    def eta(self) -> float:
        """Loss factor."""
        return self.material.loss_factor if self.loss_factor is None else self.loss_factor

    @property
    def bending_stiffness_n_m(self) -> float:
        """B' = E h^3 / (12 (1 - nu^2)), N m."""
        return self.material.plane_strain_modulus_pa * self.thickness_m**3 / 12.0

    @property
    def mass_per_area_kg_m2(self) -> float:
        """m'' = rho h, kg/m^2."""
        return self.material.density_kg_m3 * self.thickness_m

    @property
    def modal_scale_per_kg(self) -> float:
        """lambda = 4/(m'' l_x l_y), the inverse modal mass, 1/kg."""
        return 4.0 / (self.mass_per_area_kg_m2 * self.size_m[0] * self.size_m[1])

    @property
    def infinite_plate_impedance_n_s_m(self) -> float:
        """8 sqrt(B' m''), point impedance until reflections return (Cremer & Heckl), N s/m."""
        return 8.0 * math.sqrt(self.bending_stiffness_n_m * self.mass_per_area_kg_m2)

    def modes_below(self, frequency_hz: float) -> float:
        """About how many modes the plate has up to a frequency, by its modal density."""
        density = math.sqrt(self.mass_per_area_kg_m2 / self.bending_stiffness_n_m) / (4 * math.pi)
        return density * self.size_m[0] * self.size_m[1] * 2 * math.pi * frequency_hz

    def mode_numbers(self, omega_max: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All modes up to `omega_max` rad/s by rising frequency: m, n, omega."""
        speed = math.sqrt(self.bending_stiffness_n_m / self.mass_per_area_kg_m2)
        k_max = math.sqrt(omega_max / speed) / math.pi
        m_max, n_max = (max(1, math.floor(k_max * length)) for length in self.size_m)
        m, n = (a.ravel() for a in np.meshgrid(np.arange(1, m_max + 1), np.arange(1, n_max + 1)))
        k_squared = (m * np.pi / self.size_m[0]) ** 2 + (n * np.pi / self.size_m[1]) ** 2
        omega = speed * k_squared
        order = np.argsort(omega, kind="stable")
        order = order[omega[order] <= omega_max]
        return m[order], n[order], omega[order]

    def mode_shape(self, m: np.ndarray, n: np.ndarray, point_m: tuple[float, float]) -> np.ndarray:
        """Shape of modes (m, n) at a point, shape (modes,), dimensionless."""
        x, y = point_m[0] / self.size_m[0], point_m[1] / self.size_m[1]
        return np.asarray(np.sin(m * np.pi * x) * np.sin(n * np.pi * y))


@dataclass(frozen=True)
class Oscillators:
    """The plate as seen from the contact and the actuator point; all arrays (count,).

    Oscillator i obeys q'' + eta w q' + w^2 q = lambda (contact F_contact + actuator F_actuator)
    and moves the contact point by contact * q, the actuator point by actuator * q.
    """

    omega: np.ndarray
    contact: np.ndarray
    actuator: np.ndarray
    modes: int  # modes of the plate they stand for, silent ones included


def oscillators(
    plate: Plate,
    contact_m: tuple[float, float],
    actuator_m: tuple[float, float],
    omega_max: float,
) -> Oscillators:
    """Merge modes of equal frequency and drop those that neither point moves.

    A group of equal frequency sees two forces only, along the vectors of its shapes at
    the two points; an orthonormal basis of their span (one vector, or two when the
    points differ) behaves exactly as the whole group. Raises ValueError when no mode
    is left below `omega_max`.
    """
    m, n, omega = plate.mode_numbers(omega_max)
    at_contact = plate.mode_shape(m, n, contact_m)
    at_actuator = plate.mode_shape(m, n, actuator_m)
    starts = _groups(omega)
    counts = np.diff(starts, append=len(omega))
    along = np.sqrt(np.add.reduceat(at_contact * at_contact, starts))
    shared = np.add.reduceat(at_actuator * at_contact, starts)
    moved = along > _NO_PARTICIPATION
    shared = np.divide(shared, along, out=np.zeros_like(along), where=moved)
    share = np.divide(shared, along, out=np.zeros_like(along), where=moved)
    rest = at_actuator - np.repeat(share, counts) * at_contact
    across = np.sqrt(np.add.reduceat(rest * rest, starts))
    elsewhere = across > _NO_PARTICIPATION
    if not np.any(moved | elsewhere):
        raise ValueError(
            f"no mode below {omega_max / (2 * np.pi):g} Hz moves the contact point; "
            "take a smaller step or another contact point"
        )
    first = np.stack([omega[starts], along, shared])[:, moved]
    second = np.stack([omega[starts], np.zeros_like(across), across])[:, elsewhere]
    place = np.concatenate([np.flatnonzero(moved), np.flatnonzero(elsewhere)])
    table = np.concatenate([first, second], axis=1)[:, np.argsort(place, kind="stable")]
    return Oscillators(table[0], table[1], table[2], len(omega))


def _groups(omega: np.ndarray) -> np.ndarray:
    """Where a group of equal frequencies starts among rising ones, shape (groups,)."""
    return np.flatnonzero(np.diff(omega, prepend=-1.0) > _SAME_FREQUENCY * omega)


def frequencies(
    plate: Plate,
    contact_m: tuple[float, float],
    actuator_m: tuple[float, float],
    omega_max: float,
) -> int:
    """How many oscillators `oscillators` would make, without making them."""
    m, n, omega = plate.mode_numbers(omega_max)
    if not len(omega):
        return 0
    c, a = (plate.mode_shape(m, n, point) for point in (contact_m, actuator_m))
    starts = _groups(omega)
    cc, ca, aa = (np.add.reduceat(product, starts) for product in (c * c, c * a, a * a))
    along = np.sqrt(cc) > _NO_PARTICIPATION
    if contact_m == actuator_m:
        return int(np.count_nonzero(along))
    across = aa - np.where(along, ca * ca / np.where(along, cc, 1.0), 0.0)
    # The difference cancels: what is left of a group of one mode is rounding.
    return int(np.count_nonzero(along) + np.count_nonzero(across > _ROUNDING * aa + 1e-18))


def residual_flexibility_m_n(
    plate: Plate, omega_max: float, point_m: tuple[float, float] | None = None
) -> float:
    """Static flexibility sum lambda phi^2/w^2 of all modes above `omega_max`, m/N.

    At a point: summed mode by mode up to _TAIL times that, beyond it from the modal density of
    the infinite plate, (2/pi) Y/w with Y = 1/(8 sqrt(B' m'')). Without a point: the latter only.
    """
    beyond = omega_max if point_m is None else _TAIL * omega_max
    tail = 2.0 / (math.pi * plate.infinite_plate_impedance_n_s_m * beyond)
    if point_m is None:
        return tail
    m, n, omega = plate.mode_numbers(beyond)
    left_out = omega > omega_max
    shape = plate.mode_shape(m[left_out], n[left_out], point_m)
    return tail + plate.modal_scale_per_kg * float(np.sum((shape / omega[left_out]) ** 2))
