"""The default scheme `modal`: a structure as poles, and the model of its step."""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from hertzloop.plant import actuator
from hertzloop.plant.contact.contact_kernels import ContactModel, GapPath
from hertzloop.plant.contact.yielding import yield_depth_m
from hertzloop.plant.lanes import aligned
from hertzloop.plant.numerics import damped_frequency
from hertzloop.plant.plant import GRAVITY_M_S2, NO_MODES, Plant, PlantSpec
from hertzloop.plant.schemes import modal_kernels
from hertzloop.plant.schemes.modal_kernels import ModalModel, ModalState
from hertzloop.plant.state_kernels import COUNTS_SIZE, DEEPEST
from hertzloop.plant.structures.linear import MEAN, Linear, Poles, V, X, linear_of
from hertzloop.plant.structures.modes import Oscillators
from hertzloop.plant.structures.plate import Plate

# A mode that does not move the contact is scaled as if it moved it by this share of the largest
# shape there, which is far below rounding.
_UNSEEN = 1e-30


def poles_of(spec: PlantSpec, modes: Oscillators) -> Poles:
    """The structure of a description: its modes, and what stands for those left out.

    Force and point 0 are at the contact; an actuator elsewhere is force and point 1, a sensor
    elsewhere the last point. Every z is scaled so that the contact moves by the sum of Im z, which
    spares the step two arrays: C = -j there. Raises ValueError for an infinite plate that is pushed
    or seen beside the contact.
    """
    if spec.infinite_plate:
        return _infinite(spec)
    of_modes = _oscillating(spec, modes)
    mobility = residual_mobility_m_ns(spec)
    if mobility == 0.0:
        return of_modes
    corner = residual_corner_rad_s(mobility, residual_m_n(spec))
    pole, drive, energy = residual_pole(mobility, corner)
    # It is felt at the contact alone.
    drives, sees = np.zeros(len(of_modes.drive), complex), np.zeros(len(of_modes.see), complex)
    drives[0], sees[0] = drive, -1j
    return Poles(
        np.append(of_modes.poles, pole),
        np.column_stack([of_modes.drive, drives]),
        np.column_stack([of_modes.see, sees]),
        np.column_stack([of_modes.energy, energy]),
    )


def _oscillating(spec: PlantSpec, modes: Oscillators) -> Poles:
    """Oscillators as poles, see `plant.structures.linear`, z times b/theta of the contact."""
    theta, rho = damped_frequency(modes.omega, modes.eta)
    forces, points = [modes.contact], [modes.contact]
    if not spec.same_point:
        forces.append(modes.actuator)
        points.append(modes.actuator)
    if modes.sensor is not None:
        points.append(modes.sensor)
    unseen = _UNSEEN * abs(modes.contact).max()
    scale = np.where(modes.contact == 0.0, unseen, modes.contact) / theta
    half_mass = 0.5 / modes.scale_per_kg / (scale * scale)
    rho = rho * np.ones_like(theta)
    energy = half_mass * np.stack([np.ones_like(theta), -2.0 * rho, 1.0 + 2.0 * rho * rho])
    poles = np.empty(len(theta), complex)
    poles.real, poles.imag = -rho * theta, theta
    see = np.zeros((len(points), len(theta)), complex)
    see.imag = [-shape / theta / scale for shape in points]
    drive = np.array([modes.scale_per_kg * scale * shape for shape in forces], complex)
    return Poles(poles, drive, see, energy)


def _infinite(spec: PlantSpec) -> Poles:
    """An infinite plate: its contact point keeps what an impulse moves it by, and forgets the rest
    (Zener 1941)."""
    if not spec.same_point or spec.sensor_point_m is not None:
        raise ValueError("the infinite plate knows the contact point only")
    impedance = impedance_n_s_m(spec.local_plate)
    one = np.ones((1, 1), complex)
    return Poles(np.zeros(1, complex), 1j * one / impedance, -1j * one, np.zeros((3, 1)))


def impedance_n_s_m(plate: Plate) -> float:
    """Point impedance of an infinite plate with the plate's loss factor on every mode, N s/m.

    A unit impulse displaces the point of an undamped plate by 1/Z, Z = 8 sqrt(B' m''), at once
    and for good. With eta on every mode, the integral of
    exp(-eta w t/2) sin(c w t)/(c w) over all frequencies, c = sqrt(1 - eta^2/4), is still
    constant in time: atan(2 c/eta)/c in place of pi/2.
    """
    c = math.sqrt(1.0 - plate.eta**2 / 4.0)
    return plate.infinite_plate_impedance_n_s_m * 0.5 * math.pi * c / math.atan2(2.0 * c, plate.eta)


def residual_mobility_m_ns(spec: PlantSpec) -> float:
    """Velocity by which the modes left out follow a force at once, m/(N s); zero where no damped
    pole stands for them."""
    if not spec.damped_residual or residual_m_n(spec) == 0.0:
        return 0.0
    return 1.0 / spec.local_plate.infinite_plate_impedance_n_s_m


def residual_corner_rad_s(mobility_m_ns: float, flexibility_m_n: float) -> float:
    """w_c (rad/s) above which a continuum of mobility Y has this flexibility, 2 Y/(pi w_c): near
    the highest mode taken along."""
    return 2.0 * mobility_m_ns / (math.pi * flexibility_m_n)


def residual_pole(mobility_m_ns: float, omega_c: float) -> tuple[complex, complex, np.ndarray]:
    """The modes left out of a plate as one damped pole: s, B and energy, for C = -j.

    Above w_c, see `residual_corner_rad_s`, a plate is a continuum of mobility Y; below it, what
    that continuum adds is j (Y/pi) ln((w_c + w)/(w_c - w)). The passive fit with the exact terms in
    w and w^3, no loss in w^2 and Y at infinity is, with q = j w,

        Y_t = Y q (q + 6 w_c/pi)/(q^2 + (pi/2) w_c q + 3 w_c^2).

    Its real part is Y w^4/|q^2 + ...|^2: with y'' + (pi/2) w_c y' + 3 w_c^2 y = F it loses the
    power Y y''^2 and keeps Y ((3/pi + pi/4) w_c y'^2 + 3 w_c^2 y y' + (9/pi) w_c^3 y^2).
    """
    y = mobility_m_ns
    a = 0.25 * math.pi * omega_c
    b = math.sqrt(3.0 * omega_c**2 - a * a)
    drive = complex(y * (6.0 * omega_c / math.pi - a) / b, y)
    # y and y' by Re z and Im z, from displacement Im z and velocity Im(s z), which are
    # Y (r y + y') and Y (-3 w_c^2 y + (r - pi/2 w_c) y').
    r = 6.0 * omega_c / math.pi
    rate = r - 0.5 * math.pi * omega_c
    det = y * (r * rate + 3.0 * omega_c**2)
    of_re, of_im = (-b / det, r * b / det), ((rate + a) / det, (3.0 * omega_c**2 - r * a) / det)

    def keeps(one: tuple[float, float], other: tuple[float, float]) -> float:
        (y_1, rate_1), (y_2, rate_2) = one, other
        of_rates = (3.0 / math.pi + 0.25 * math.pi) * omega_c * rate_1 * rate_2
        mixed = 1.5 * omega_c**2 * (y_1 * rate_2 + rate_1 * y_2)
        return y * (of_rates + mixed + 9.0 / math.pi * omega_c**3 * y_1 * y_2)

    energy = np.array([keeps(of_re, of_re), 2.0 * keeps(of_re, of_im), keeps(of_im, of_im)])
    return complex(-a, b), drive, energy


def series_residual_m_n(spec: PlantSpec) -> float:
    """Spring that stands for the modes left out, m/N; zero if the description has none."""
    return 0.0 if spec.damped_residual or spec.infinite_plate else residual_m_n(spec)


@lru_cache(maxsize=64)
def residual_m_n(spec: PlantSpec) -> float:
    """Static flexibility of the modes left out at the contact, m/N."""
    if not spec.residual_flexibility:
        return 0.0
    if spec.mass_at_contact:
        return 0.0  # the spring is under the mass: one of its modes
    return spec.plate.residual_flexibility_m_n(
        2.0 * math.pi * spec.frequency_limit_hz, spec.contact_point_m
    )


def build_model(spec: PlantSpec, modes: Oscillators) -> ModalModel:
    """Coefficients of one step. Raises ValueError as `poles_of`."""
    structure = poles_of(spec, modes)
    linear = linear_of(structure, spec.step_s)
    residual = series_residual_m_n(spec)
    return ModalModel(
        step_s=spec.step_s,
        linear=linear,
        actuator=actuator.build_model(spec.actuator, spec.step_s),
        actuator_force=len(linear.direct[0]) - 1,
        actuator_point=0 if spec.same_point else 1,
        sensor_point=0 if spec.sensor_point_m is None else len(linear.direct) - 1,
        raised_by_m_n=residual if spec.same_point else 0.0,
        damped=bool(np.any(structure.poles.real < 0.0) or np.any(linear.direct)),
        **_of_contact(spec, linear, residual),
    )


def _of_contact(spec: PlantSpec, linear: Linear, residual: float) -> dict[str, Any]:
    """The fields of a model that sphere and contact decide."""
    h, m = spec.step_s, spec.sphere.mass_kg
    mobility = float(linear.direct[0, 0])
    by_0, by_1 = linear.gain[0, :, 0].T.tolist()
    contact = spec.contact
    # The gap is sphere minus plate: a unit F_0 lifts the sphere by h^2/2m, its mean by h^2/6m; a
    # unit F_1 by -h^2/6m and -h^2/12m. Each lowers the plate by its gain.
    return {
        "mass_kg": m,
        "gravity_m_s2": GRAVITY_M_S2,
        "contact": ContactModel(
            contact.stiffness,
            yield_depth_m(contact),
            contact.viscous_n_s_m,
            contact.hunt_crossley_s_m,
            residual,
        ),
        "by_0": GapPath(
            0.0,
            by_0[X] + h * h / (2.0 * m),
            h * mobility,
            h * (by_0[V] + mobility + h / m),
            by_0[MEAN] + h * h / (6.0 * m),
        ),
        "by_1": GapPath(
            0.0,
            by_1[X] - h * h / (6.0 * m),
            -h * mobility,
            h * (by_1[V] + mobility),
            by_1[MEAN] - h * h / (12.0 * m),
        ),
    }


def with_contact(model: ModalModel, spec: PlantSpec) -> ModalModel:
    """Return the model of the same structure with the sphere and the contact of `spec`."""
    return model._replace(**_of_contact(spec, model.linear, model.contact.residual_m_n))


class ModalPlant(Plant):
    """The default scheme `modal`: order 4, energy to rounding; also of an infinite plate.

    Raises ValueError as `poles_of`.
    """

    kernels: Any = modal_kernels

    @classmethod
    def refusal(cls, what: str, value: object = None) -> str:
        """See `Plant`: all but a damping that the contact does not have."""
        return super().refusal(what, value) if what == "contact.damping" else ""

    def _structure_modes(self) -> Oscillators:
        return NO_MODES if self.spec.infinite_plate else super()._structure_modes()

    def _build_model(self) -> ModalModel:
        return build_model(self.spec, self.modes)

    def _empty_state(self) -> ModalState:
        linear = self.model.linear
        points, forces = linear.direct.shape
        state = ModalState(
            z=aligned(np.zeros_like(linear.turn)),
            force=np.zeros((forces, 2)),
            seen=np.zeros((points, 2)),
            before=np.zeros((points, 2)),
            body=np.zeros(modal_kernels.BODY_SIZE),
            balance=np.zeros(modal_kernels.BALANCE_SIZE),
            counts=np.zeros(COUNTS_SIZE, np.int64),
        )
        if self.model.contact.yield_m < math.inf:
            state.body[DEEPEST] = self.model.contact.yield_m
        return state
