"""The scheme `discrete_gradient`: order 2, a contact force that is constant over a step.

A scheme that hertzloop does not know, to compare its default scheme with, and an example of a
scheme of one's own: kernels with a model and a state, a subclass of `Plant` that makes both, and a
row for the table of schemes that says what it supports.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from benchmarks.schemes import discrete_gradient_kernels
from benchmarks.schemes.discrete_gradient_kernels import (
    A_IM,
    A_RE,
    B_A,
    B_C,
    C_IM,
    C_RE,
    COLUMNS,
    ENERGY,
    LANES,
    LOSS_II,
    LOSS_RI,
    LOSS_RR,
    ROT_IM,
    ROT_RE,
    SWING_A_IM,
    SWING_A_RE,
    SWING_C_IM,
    SWING_C_RE,
    THETA,
)
from hertzloop.plant import state_kernels
from hertzloop.plant.numerics import damped_frequency, phi
from hertzloop.plant.plant import Plant, PlantSpec, common_fields
from hertzloop.plant.schemes.registry import SCHEMES, Scheme
from hertzloop.plant.state_kernels import BALANCE_SIZE, BODY_SIZE, COUNTS_SIZE
from hertzloop.plant.structures.modes import Oscillators

NAME = "discrete_gradient"
SCHEME = Scheme(f"{__name__}:DiscreteGradientPlant")


@contextmanager
def known_to_scenes() -> Iterator[None]:
    """Let scenes name the scheme meanwhile: `run.scheme = "discrete_gradient"`."""
    SCHEMES[NAME] = SCHEME
    try:
        yield
    finally:
        del SCHEMES[NAME]


def _rows(values: np.ndarray, fill: float = 0.0) -> np.ndarray:
    """Fill up to whole rows of LANES."""
    count = -(-len(values) // LANES)
    padded = np.full(count * LANES, fill)
    padded[: len(values)] = values
    return padded.reshape(count, LANES)


def build_model(spec: PlantSpec, modes: Oscillators) -> discrete_gradient_kernels.PlantModel:
    """Coefficients of one exact step for every oscillator (arrays: rows x LANES).

    Raises ValueError for loss factors that differ from mode to mode.
    """
    h = spec.step_s
    eta, scale = modes.eta, modes.scale_per_kg
    theta, rho = damped_frequency(modes.omega, modes.eta)
    if isinstance(eta, np.ndarray) or isinstance(rho, np.ndarray):
        raise ValueError(
            f"loss factors that differ from mode to mode: not supported by run.scheme = '{NAME}'. "
            "Use 'modal'."
        )
    s = (-rho + 1j) * theta
    turn = np.exp(s * h)
    # A held force f/Theta moves z by f/Theta (e^(sh) - 1)/s; the rest position is -f/(Theta s).
    # Written with phi_1: the difference would cancel for slow modes and short steps.
    grown = scale / theta * h * phi(1, s * h)
    swing = scale / theta / s * turn  # z minus its rest position, after that step from zero
    b_c, b_a = modes.contact, modes.actuator

    def gain(out: np.ndarray, drive: np.ndarray) -> float:
        return float(np.sum(out * drive * grown.imag))

    def speed_gain(drive: np.ndarray) -> float:
        return float(np.sum(b_c * drive * theta * (grown.real - rho * grown.imag)))

    energy = np.broadcast_to(0.5 / scale, theta.shape)
    loss_rr, loss_ri, loss_ii = _loss_form(theta, rho, h, turn, energy)
    columns = {
        ROT_RE: turn.real,
        ROT_IM: turn.imag,
        C_RE: b_c * grown.real,
        C_IM: b_c * grown.imag,
        THETA: theta,
        A_RE: b_a * grown.real,
        A_IM: b_a * grown.imag,
        B_C: b_c,
        B_A: b_a,
        ENERGY: energy,
        SWING_C_RE: b_c * swing.real,
        SWING_C_IM: b_c * swing.imag,
        SWING_A_RE: b_a * swing.real,
        SWING_A_IM: b_a * swing.imag,
        LOSS_RR: loss_rr,
        LOSS_RI: loss_ri,
        LOSS_II: loss_ii,
    }
    return discrete_gradient_kernels.PlantModel(
        step_s=h,
        damped=eta > 0.0,
        rho=rho,
        gain_cc=gain(b_c, b_c),
        gain_ca=gain(b_c, b_a),
        gain_ac=gain(b_a, b_c),
        gain_aa=gain(b_a, b_a),
        speed_gain_cc=speed_gain(b_c),
        speed_gain_ca=speed_gain(b_a),
        # Padding divides by theta; with no drive it never moves.
        table=np.stack([_rows(columns[c], float(c == THETA)) for c in range(COLUMNS)]),
        **common_fields(spec),
    )


def _loss_form(
    theta: np.ndarray, rho: float, h: float, turn: np.ndarray, energy: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Energy lost in a step as rr yr^2 + ri yr yi + ii yi^2 of y = yr + i yi at its end."""
    dissipation = state_kernels.dissipation
    dissipation = getattr(dissipation, "py_func", dissipation)  # for arrays

    def lost(y_end: complex) -> np.ndarray:
        y = y_end / turn
        terms = dissipation(theta, rho, h, y.real, y.imag, turn.real, turn.imag)
        return np.asarray(energy * terms)

    rr, ii = lost(1.0), lost(1.0j)
    return rr, lost(1.0 + 1.0j) - rr - ii, ii


class DiscreteGradientPlant(Plant):
    """Model and state of the second-order scheme, driven by its kernels' `step`."""

    kernels: Any = discrete_gradient_kernels

    def _build_model(self) -> Any:
        return build_model(self.spec, self.modes)

    def _empty_state(self) -> discrete_gradient_kernels.PlantState:
        rows = self.model.table.shape[1]
        return discrete_gradient_kernels.PlantState(
            z=np.zeros((2, rows, LANES)),
            lanes=np.zeros((3, LANES)),
            body=np.zeros(BODY_SIZE),
            balance=np.zeros(BALANCE_SIZE),
            counts=np.zeros(COUNTS_SIZE, np.int64),
        )
