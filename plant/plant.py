"""A plant made from a description: model arrays, initial state, books at the end."""

import math
from copy import copy
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np

from plant.actuator.mass import mass_loaded
from plant.actuator.model import IDEAL, Actuator
from plant.books import Books, balance
from plant.contact.hertz import GRAVITY_M_S2, Contact, Sphere
from plant.schemes import discrete_gradient_kernels as k
from plant.schemes import sphere_kernels as sphere_k
from plant.schemes import state_kernels as pk
from plant.schemes.phi import phi
from plant.structures.plate import Oscillators, Plate, oscillators
from plant.structures.radiation import air_loss_factor
from plant.structures.solid_plate import SolidPlate
from plant.structures.structure import Structure


@dataclass(frozen=True)
class PlantSpec:
    """All that decides a run of the plant, in SI units.

    The run starts `lead_in_s` before the first contact (or at the release, if that is
    later); the plate is at rest until then, so nothing is left out. A lead-in above zero is
    rounded to whole steps and a touch phase, half a step unless asked otherwise: a contact that
    begins right on a sample would leave it to rounding whether that sample is in contact.
    """

    sphere: Sphere
    plate: Structure
    contact: Contact
    contact_point_m: tuple[float, float]
    actuator_point_m: tuple[float, float]
    step_s: float
    frequency_limit_hz: float
    lead_in_s: float
    residual_flexibility: bool = False  # of the modes left out, as a spring at the contact
    damped_tail: bool = False  # that as a damped mode in place of the spring
    infinite_plate: bool = False  # no modes: a dashpot, until reflections return
    actuator: Actuator = IDEAL
    radiating_faces: int = 0  # of a plate whose modes are damped by air

    def __hash__(self) -> int:
        """Kept: what follows from a description is looked up by it again and again."""
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash(tuple(getattr(self, part.name) for part in fields(self)))

    @cached_property
    def same_point(self) -> bool:
        """Whether the actuator pushes at the struck point."""
        return self.plate.same_point(self.contact_point_m, self.actuator_point_m)

    @property
    def simply_supported(self) -> Plate:
        """The plate, for what is known of a simply supported one only. Raises ValueError."""
        if isinstance(self.plate, SolidPlate):
            return self.plate.plate
        if not isinstance(self.plate, Plate):
            raise ValueError(f"not defined for {self.plate}; it takes a simply supported plate")
        return self.plate

    @property
    def local_plate(self) -> Plate:
        """What the contact feels until reflections return. Raises ValueError if there is none."""
        if self.plate.local_plate is None:
            raise ValueError(
                "the impedance of an infinite plate is not known for plate.modes alone; give "
                "plate.thickness_m, if what is struck is a plate there"
            )
        return self.plate.local_plate


MOST_MODES = 500_000
# What stands for the modes where there are none, or too many to compute.
NO_MODES = Oscillators(np.zeros(0), np.zeros(0), np.zeros(0), 0, 0.0, 1.0)
_MOST_ETA = 1.9  # a mode is critically damped at 2
RIGID_RAD_S = 1e-9  # after 20 s the displacement is wrong by 7e-17


@lru_cache(maxsize=8)
def modes_of(spec: PlantSpec) -> Oscillators:
    """Oscillators of a description: of its structure with the actuator's mass on it, in air. Kept:
    the plant has them, and the figures of its runs. `NO_MODES` for an infinite plate with too many.

    Raises ValueError for a mass on modes with loss factors of their own, or on a rigid body's,
    and where air would damp a mode critically, or what is struck is no plate that it is known for.
    """
    if spec.infinite_plate and spec.plate.modes_below(spec.frequency_limit_hz) > MOST_MODES:
        return NO_MODES
    modes = _in_vacuum(spec)
    if not spec.radiating_faces:
        return modes
    eta = np.asarray(modes.eta + air_eta(spec, modes.omega))
    if not np.max(eta) < _MOST_ETA:
        raise ValueError(
            f"plate.radiation would give a mode a loss factor of {np.max(eta):.3g}, the most is "
            f"{_MOST_ETA:g}; take a thicker plate, or leave the key out"
        )
    return replace(modes, eta=eta)


def air_eta(spec: PlantSpec, omega: np.ndarray) -> np.ndarray:
    """Loss factor that radiation adds to modes of these frequencies (rad/s), same shape."""
    if not spec.radiating_faces:
        return np.zeros_like(omega)
    return air_loss_factor(spec.simply_supported, omega / (2.0 * np.pi), spec.radiating_faces)


def _in_vacuum(spec: PlantSpec) -> Oscillators:
    omega_max = 2.0 * math.pi * spec.frequency_limit_hz
    at_actuator = spec.actuator_point_m
    modes = oscillators(spec.plate, spec.contact_point_m, at_actuator, omega_max)
    if spec.actuator.mass_kg == 0.0:
        return modes
    if isinstance(modes.eta, np.ndarray):
        raise ValueError(
            f"actuator.mass_kg = {spec.actuator.mass_kg:g} needs one loss factor for all modes; "
            "leave it out, or give plate.modes of one loss factor"
        )
    if modes.omega[0] <= RIGID_RAD_S:
        raise ValueError(
            f"actuator.mass_kg = {spec.actuator.mass_kg:g} does not fit a plate that moves freely "
            "as a whole; leave it out, or hold one of plate.edges"
        )
    spring = 0.0
    if spec.residual_flexibility:
        spring = spec.plate.residual_flexibility_m_n(omega_max, at_actuator)
    return mass_loaded(modes, modes.scale_per_kg, spec.actuator.mass_kg, spring, spec.same_point)


def _rows(values: np.ndarray, fill: float = 0.0) -> np.ndarray:
    """Fill up to whole rows of LANES."""
    count = -(-len(values) // k.LANES)
    padded = np.full(count * k.LANES, fill)
    padded[: len(values)] = values
    return padded.reshape(count, k.LANES)


def damped_frequency(modes: Oscillators) -> tuple[np.ndarray, float | np.ndarray]:
    """Theta of every oscillator (rad/s), and delta/Theta: one number, or one for every oscillator.

    A rigid body's mode takes a frequency so low that within any run it turns by less than
    rounding can show.
    """
    omega = np.maximum(modes.omega, RIGID_RAD_S)
    if isinstance(modes.eta, np.ndarray):
        root = np.sqrt(1.0 - modes.eta * modes.eta / 4.0)
        return omega * root, (modes.eta / 2.0) / root
    one_root = math.sqrt(1.0 - modes.eta * modes.eta / 4.0)
    return omega * one_root, (modes.eta / 2.0) / one_root


def build_model(spec: PlantSpec, modes: Oscillators) -> k.PlantModel:
    """Coefficients of one exact step for every oscillator (arrays: rows x LANES).

    Raises ValueError for loss factors that differ from mode to mode.
    """
    h = spec.step_s
    eta, scale = modes.eta, modes.scale_per_kg
    theta, rho = damped_frequency(modes)
    if isinstance(eta, np.ndarray) or isinstance(rho, np.ndarray):
        raise ValueError(
            "loss factors that differ from mode to mode are known to run.scheme = 'modal' only, "
            "not to 'discrete_gradient'; take that scheme"
        )
    s = (-rho + 1j) * theta
    turn = np.exp(s * h)
    # A held force f/Theta moves z by f/Theta (e^(sh) - 1)/s; the rest position is -f/(Theta s).
    # Written with phi_1: the difference would cancel for slow modes and short steps.
    grown = scale / theta * h * phi(1, s * h)
    swing = scale / theta / s * turn  # z minus its rest position, after that step from zero
    same = spec.same_point
    b_c, b_a = modes.contact, modes.actuator
    # At one point z carries the output weight as well, so that the outputs are plain sums.
    drive_c, drive_a = (b_c * b_c, b_c * b_c) if same else (b_c, b_a)
    weight_c, weight_a = (np.ones_like(b_c),) * 2 if same else (b_c, b_a)

    def gain(out: np.ndarray, drive: np.ndarray) -> float:
        return float(np.sum(out * drive * grown.imag))

    def speed_gain(drive: np.ndarray) -> float:
        return float(np.sum(weight_c * drive * theta * (grown.real - rho * grown.imag)))

    energy = 1.0 / (2.0 * scale * (b_c * b_c if same else np.ones_like(b_c)))
    loss_rr, loss_ri, loss_ii = _loss_form(theta, rho, h, turn, energy)
    columns = {
        k.ROT_RE: turn.real,
        k.ROT_IM: turn.imag,
        k.C_RE: drive_c * grown.real,
        k.C_IM: drive_c * grown.imag,
        k.THETA: theta,
        k.A_RE: drive_a * grown.real,
        k.A_IM: drive_a * grown.imag,
        k.B_C: weight_c,
        k.B_A: weight_a,
        k.ENERGY: energy,
        k.SWING_C_RE: drive_c * swing.real,
        k.SWING_C_IM: drive_c * swing.imag,
        k.SWING_A_RE: drive_a * swing.real,
        k.SWING_A_IM: drive_a * swing.imag,
        k.LOSS_RR: loss_rr,
        k.LOSS_RI: loss_ri,
        k.LOSS_II: loss_ii,
    }
    return k.PlantModel(
        step_s=h,
        mass_kg=spec.sphere.mass_kg,
        gravity_m_s2=GRAVITY_M_S2,
        stiffness=spec.contact.stiffness,
        viscous_n_s_m=spec.contact.viscous_n_s_m,
        hunt_crossley_s_m=spec.contact.hunt_crossley_s_m,
        same_point=same,
        damped=eta > 0.0,
        rho=rho,
        gain_cc=gain(weight_c, drive_c),
        gain_ca=gain(weight_c, drive_a),
        gain_ac=gain(weight_a, drive_c),
        gain_aa=gain(weight_a, drive_a),
        speed_gain_cc=speed_gain(drive_c),
        speed_gain_ca=speed_gain(drive_a),
        # Padding divides by theta; with no drive it never moves.
        table=np.stack([_rows(columns[c], float(c == k.THETA)) for c in range(k.COLUMNS)]),
    )


def _loss_form(
    theta: np.ndarray, rho: float, h: float, turn: np.ndarray, energy: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Energy lost in a step as rr yr^2 + ri yr yi + ii yi^2 of y = yr + i yi at its end."""

    def lost(y_end: complex) -> np.ndarray:
        y = y_end / turn
        terms = pk.dissipation(theta, rho, h, y.real, y.imag, turn.real, turn.imag)
        return np.asarray(energy * terms)

    rr, ii = lost(1.0), lost(1.0j)
    return rr, lost(1.0 + 1.0j) - rr - ii, ii


class Plant:
    """The second-order scheme `discrete_gradient`: model and state, driven by `kernels.step`.

    Other schemes offer the same attributes and the same kernel signature
    step(model, state, f_a) -> f_c.
    """

    scheme = "discrete_gradient"
    kernels: Any = k
    touch_phase = 0.5  # of a step, from the last sample above the plate to the first touch

    def __init__(self, spec: PlantSpec) -> None:
        self.spec = spec
        self.modes = modes_of(spec)
        self.model: Any = self._build_model()
        self.state = self._initial_state()

    def _build_model(self) -> Any:
        return build_model(self.spec, self.modes)

    def at_start(self, touch_phase: float = 0.5) -> Self:
        """The same plant at the start of a run: model shared, state new."""
        new = copy(self)
        new.touch_phase = touch_phase
        new.state = new._initial_state()
        return new

    def contact_energy_j(self) -> float:
        """Energy stored in the contact at the present step, J."""
        penetration = max(-float(self.state.body[pk.XI]), 0.0)
        return float(0.4 * self.model.stiffness * penetration**2.5)

    def _empty_state(self) -> Any:
        rows = self.model.table.shape[1]
        state = k.PlantState(
            z=np.zeros((2, rows, k.LANES)),
            free=np.zeros((2, rows, k.LANES)),
            lanes=np.zeros((3, k.LANES)),
            body=np.zeros(pk.BODY_SIZE),
            books=np.zeros(pk.BOOKS_SIZE),
            counts=np.zeros(pk.COUNTS_SIZE, np.int64),
        )
        state.counts[pk.ROWS] = rows
        return state

    def _initial_state(self) -> Any:
        state = self._empty_state()
        spec = self.spec
        state.body[pk.FLIGHT_X], state.body[pk.FLIGHT_V] = sphere_k.released(
            float(spec.sphere.impact_speed_m_s), GRAVITY_M_S2, float(spec.lead_in_s), spec.step_s,
            float(self.touch_phase),
        )  # fmt: skip
        state.body[pk.XI] = state.body[pk.XI_S] = state.body[pk.FLIGHT_X]
        self._start = state.body[[pk.FLIGHT_X, pk.FLIGHT_V]].copy()
        return state

    def sphere_speed_m_s(self) -> float:
        """Speed of the sphere at the present step, up positive."""
        body, counts = self.state.body, self.state.counts
        return float(sphere_k.speed_now(GRAVITY_M_S2, self.model.step_s, body, counts))

    def close_books(self) -> Books:
        """Balance of the run so far; to be called once, at its end. See `balance`."""
        self.kernels.close_books(self.model, self.state)
        return balance(
            self.model,
            self.state,
            self._start,
            self.sphere_speed_m_s(),
            modal_j=float(self.kernels.modal_energy(self.model, self.state)),
            contact_j=self.contact_energy_j(),
        )
