"""A plant made from a description: model arrays, initial state, books at the end."""

import math
from copy import copy
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from plant import kernels as k
from plant.contact import GRAVITY_M_S2, Contact, Sphere
from plant.phi import phi
from plant.plate import Oscillators, Plate, oscillators


@dataclass(frozen=True)
class PlantSpec:
    """All that decides a run of the plant, in SI units.

    The run starts `lead_in_s` before the first contact (or at the release, if that is
    later); the plate is at rest until then, so nothing is left out. A lead-in above zero is
    rounded to an odd number of half steps: a contact that begins right on a sample would
    leave it to rounding whether that sample is in contact.
    """

    sphere: Sphere
    plate: Plate
    contact: Contact
    contact_point_m: tuple[float, float]
    actuator_point_m: tuple[float, float]
    step_s: float
    frequency_limit_hz: float
    lead_in_s: float
    residual_flexibility: bool = False  # of the modes left out, as a spring at the contact
    infinite_plate: bool = False  # no modes: a dashpot, until reflections return


@dataclass(frozen=True)
class Books:
    """Energy (J) and momentum (N s) of a run; residuals are relative, see `balance`."""

    energy_start_j: float
    kinetic_j: float
    gravity_j: float
    modal_j: float
    contact_j: float
    modal_dissipated_j: float
    contact_dissipated_j: float
    injected_j: float
    energy_residual: float
    momentum_change_n_s: float
    contact_impulse_n_s: float
    gravity_impulse_n_s: float
    momentum_residual: float
    newton_iterations: int
    newton_iterations_max: int
    contact_steps: int


def _rows(values: np.ndarray, fill: float = 0.0) -> np.ndarray:
    """Fill up to whole rows of LANES."""
    count = -(-len(values) // k.LANES)
    padded = np.full(count * k.LANES, fill)
    padded[: len(values)] = values
    return padded.reshape(count, k.LANES)


def build_model(spec: PlantSpec, modes: Oscillators) -> k.PlantModel:
    """Coefficients of one exact step for every oscillator (arrays: rows x LANES)."""
    h = spec.step_s
    eta = spec.plate.eta
    scale = spec.plate.modal_scale_per_kg
    theta = modes.omega * math.sqrt(1.0 - eta * eta / 4.0)
    rho = (eta / 2.0) / math.sqrt(1.0 - eta * eta / 4.0)
    s = (-rho + 1j) * theta
    turn = np.exp(s * h)
    # A held force f/Theta moves z by f/Theta (e^(sh) - 1)/s; the rest position is -f/(Theta s).
    # Written with phi_1: the difference would cancel for slow modes and short steps.
    grown = scale / theta * h * phi(1, s * h)
    swing = scale / theta / s * turn  # z minus its rest position, after that step from zero
    same = spec.contact_point_m == spec.actuator_point_m
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
        terms = k.dissipation(theta, rho, h, y.real, y.imag, turn.real, turn.imag)
        return np.asarray(energy * terms)

    rr, ii = lost(1.0), lost(1.0j)
    return rr, lost(1.0 + 1.0j) - rr - ii, ii


def balance(
    model: Any,
    state: Any,
    start: np.ndarray,
    speed_m_s: float,
    *,
    modal_j: float,
    contact_j: float,
) -> Books:
    """Books of a run that began with the sphere at `start` (m, m/s) and ends at `speed_m_s`.

    The energy residual is relative to the energy at the start plus the size of what the
    actuator exchanged, the momentum residual to the impulses exchanged.
    """
    m, (x0, v0) = model.mass_kg, (float(x) for x in start)
    energy = m * GRAVITY_M_S2 * x0 + 0.5 * m * v0 * v0
    kinetic = 0.5 * m * speed_m_s * speed_m_s
    gravity = m * GRAVITY_M_S2 * float(state.body[k.XI_S])
    lost_modal, lost_contact, injected, impulse = (float(b) for b in state.books)
    gap = kinetic + gravity + modal_j + contact_j + lost_modal + lost_contact - injected - energy
    change = m * (speed_m_s - v0)
    weight = -m * GRAVITY_M_S2 * float(state.counts[k.STEP]) * model.step_s
    return Books(
        energy_start_j=energy,
        kinetic_j=kinetic,
        gravity_j=gravity,
        modal_j=modal_j,
        contact_j=contact_j,
        modal_dissipated_j=lost_modal,
        contact_dissipated_j=lost_contact,
        injected_j=injected,
        energy_residual=gap / (energy + abs(injected)),
        momentum_change_n_s=change,
        contact_impulse_n_s=impulse,
        gravity_impulse_n_s=weight,
        momentum_residual=(change - impulse - weight) / (abs(impulse) + abs(weight) + m * abs(v0)),
        newton_iterations=int(state.counts[k.NEWTON_TOTAL]),
        newton_iterations_max=int(state.counts[k.NEWTON_MAX]),
        contact_steps=int(state.counts[k.CONTACT_STEPS]),
    )


class Plant:
    """The second-order scheme `discrete_gradient`: model and state, driven by `kernels.step`.

    Other schemes offer the same attributes and the same kernel signature
    step(model, state, f_a) -> f_c.
    """

    scheme = "discrete_gradient"
    kernels: Any = k

    def __init__(self, spec: PlantSpec) -> None:
        self.spec = spec
        self.modes = oscillators(
            spec.plate,
            spec.contact_point_m,
            spec.actuator_point_m,
            2.0 * math.pi * spec.frequency_limit_hz,
        )
        self.model: Any = self._build_model()
        self.state = self._initial_state()

    def _build_model(self) -> Any:
        return build_model(self.spec, self.modes)

    def at_start(self) -> Self:
        """The same plant at the start of a run: model shared, state new."""
        new = copy(self)
        new.state = new._initial_state()
        return new

    def contact_energy_j(self) -> float:
        """Energy stored in the contact at the present step, J."""
        penetration = max(-float(self.state.body[k.XI]), 0.0)
        return float(0.4 * self.model.stiffness * penetration**2.5)

    def _empty_state(self) -> Any:
        rows = self.model.table.shape[1]
        state = k.PlantState(
            z=np.zeros((2, rows, k.LANES)),
            free=np.zeros((2, rows, k.LANES)),
            lanes=np.zeros((3, k.LANES)),
            body=np.zeros(k.BODY_SIZE),
            books=np.zeros(k.BOOKS_SIZE),
            counts=np.zeros(k.COUNTS_SIZE, np.int64),
        )
        state.counts[k.ROWS] = rows
        return state

    def _initial_state(self) -> Any:
        state = self._empty_state()
        speed = self.spec.sphere.impact_speed_m_s
        fall_s = speed / GRAVITY_M_S2
        lead, h = self.spec.lead_in_s, self.spec.step_s
        if lead > 0.0:
            lead = min((math.floor(lead / h) + 0.5) * h, fall_s)
        # Going back in time from the impact: height v t - g t^2/2, speed -(v - g t).
        state.body[k.FLIGHT_X] = lead * (speed - 0.5 * GRAVITY_M_S2 * lead)
        state.body[k.FLIGHT_V] = GRAVITY_M_S2 * lead - speed
        state.body[k.XI] = state.body[k.XI_S] = state.body[k.FLIGHT_X]
        self._start = state.body[[k.FLIGHT_X, k.FLIGHT_V]].copy()
        return state

    def sphere_speed_m_s(self) -> float:
        """Speed of the sphere at the present step, up positive."""
        counts = self.state.counts
        flight_s = (counts[k.STEP] - counts[k.FLIGHT_STEP]) * self.model.step_s
        return float(self.state.body[k.FLIGHT_V] - GRAVITY_M_S2 * flight_s)

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
