"""The default scheme `modal`: coefficients of the energy-preserving collocation step."""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from plant import collocation_kernels as k
from plant import contact_solve_kernels as solve
from plant import kernels as pk
from plant.contact import GRAVITY_M_S2
from plant.phi import phi
from plant.plant import Plant, PlantSpec
from plant.plate import Oscillators, residual_flexibility_m_n


def build_model(spec: PlantSpec, modes: Oscillators) -> k.CollocationModel:
    """Coefficients of one step for every oscillator."""
    h, m = spec.step_s, spec.sphere.mass_kg
    eta, scale = spec.plate.eta, spec.plate.modal_scale_per_kg
    theta = modes.omega * math.sqrt(1.0 - eta * eta / 4.0)
    rho = (eta / 2.0) / math.sqrt(1.0 - eta * eta / 4.0)
    s = (-rho + 1j) * theta
    x = s * h
    turn, one, two, three = (phi(i, x) for i in range(4))
    constant = scale * h * one  # change of z by a unit force, by a unit P(t)
    linear = scale * h * x * (2.0 * three - two)
    mean_constant = scale * h * two  # their shares of the mean over the step
    mean_linear = scale * h * (2.0 * three - two)
    same = spec.contact_point_m == spec.actuator_point_m
    b_c, b_a = modes.contact, modes.actuator
    drive_c, drive_a = (b_c * b_c, b_c * b_c) if same else (b_c, b_a)
    weight_c, weight_a = (np.ones_like(b_c),) * 2 if same else (b_c, b_a)

    def moves(weight: np.ndarray, drive: np.ndarray, z: np.ndarray) -> float:
        return float(np.sum(weight * drive * z.imag / theta))

    def speeds(drive: np.ndarray, z: np.ndarray) -> float:
        return float(np.sum(weight_c * drive * (z.real - rho * z.imag)))

    gains = np.zeros(solve.GAINS)
    gains[solve.PX0], gains[solve.PX1] = (moves(weight_c, drive_c, z) for z in (constant, linear))
    gains[solve.PV0], gains[solve.PV1] = (speeds(drive_c, z) for z in (constant, linear))
    gains[solve.PM0], gains[solve.PM1] = (
        moves(weight_c, drive_c, z) for z in (mean_constant, mean_linear)
    )
    gains[solve.X0] = gains[solve.PX0] + h * h / (2.0 * m)
    gains[solve.X1] = gains[solve.PX1] - h * h / (6.0 * m)
    gains[solve.V0], gains[solve.V1] = gains[solve.PV0] + h / m, gains[solve.PV1]
    gains[solve.M0] = gains[solve.PM0] + h * h / (6.0 * m)
    gains[solve.M1] = gains[solve.PM1] - h * h / (12.0 * m)
    gains[solve.CA], gains[solve.VA] = moves(weight_c, drive_a, constant), speeds(drive_a, constant)
    gains[solve.MA] = moves(weight_c, drive_a, mean_constant)
    gains[solve.AC0], gains[solve.AC1] = (moves(weight_a, drive_c, z) for z in (constant, linear))
    gains[solve.AA] = moves(weight_a, drive_a, constant)
    slow = int(np.searchsorted(theta * h, _SLOW))  # oscillators are sorted by frequency
    gains[solve.SWING0], gains[solve.SWING1] = (
        np.sum((drive_c * (z.real + rho * z.imag) / theta**2)[slow:]) for z in (constant, linear)
    )
    gains[solve.MEAN_BY_SWING] = -1.0 / (h * (1.0 + rho * rho))
    gains[solve.NODE0 :] = solve.at_nodes(gains, h)

    columns = {
        k.ROT_RE: turn.real,
        k.ROT_IM: turn.imag,
        k.C0_RE: drive_c * constant.real,
        k.C0_IM: drive_c * constant.imag,
        k.C1_RE: drive_c * linear.real,
        k.C1_IM: drive_c * linear.imag,
        k.OUT: weight_c / theta,
        # From z at the end of a step without force: phi_1(x)/e^x = phi_1(-x).
        k.MEAN_RE: phi(1, -x).real * weight_c / theta,
        k.MEAN_IM: phi(1, -x).imag * weight_c / theta,
        k.THETA: theta,
        k.A_RE: drive_a * constant.real,
        k.A_IM: drive_a * constant.imag,
        k.B_C: weight_c,
        k.B_A: weight_a / theta,
        k.ENERGY: 1.0 / (2.0 * scale * (b_c * b_c if same else np.ones_like(b_c))),
    }
    if eta > 0.0:
        lost, sums = _losses(s, rho, h, scale, columns[k.ENERGY], drive_c, drive_a)
        columns |= lost
        for index, value in sums.items():
            gains[index] = value
    return k.CollocationModel(
        step_s=h,
        mass_kg=m,
        gravity_m_s2=GRAVITY_M_S2,
        stiffness=spec.contact.stiffness,
        flexibility_m_n=flexibility_m_n(spec),
        viscous_n_s_m=spec.contact.viscous_n_s_m,
        hunt_crossley_s_m=spec.contact.hunt_crossley_s_m,
        same_point=same,
        damped=eta > 0.0,
        rho=rho,
        slow=slow,
        gains=gains,
        table=np.stack([columns.get(c, np.zeros_like(theta)) for c in range(k.COLUMNS)]),
    )


@lru_cache(maxsize=64)
def flexibility_m_n(spec: PlantSpec) -> float:
    """Spring that stands for the modes left out, m/N; zero if the description has none."""
    if not spec.residual_flexibility:
        return 0.0
    return residual_flexibility_m_n(
        spec.plate, 2.0 * math.pi * spec.frequency_limit_hz, spec.contact_point_m
    )


_SLOW = 0.02  # of w h; the difference of two `swing` loses as many digits as this has
_NODES = 24  # of the time integral while no mode turns by more than pi in a step
_NODES_PER_RADIAN = 0.75  # more for the turn beyond; Gauss's rule needs half a node a radian


def _losses(
    s: np.ndarray, rho: float, h: float, scale: float, energy: np.ndarray,
    drive_c: np.ndarray, drive_a: np.ndarray,
) -> tuple[dict[int, np.ndarray], dict[int, float]]:  # fmt: skip
    """Energy that damped oscillators lose in a step, 2 delta m times the integral of v^2.

    v is linear in z at the end of the step without forces, and in F_0, F_1, F_a, each of which
    moves the mass from rest in a known way; the coefficients of all products are integrated
    by Gauss's rule. (The closed form is a difference of large numbers for slow modes.)
    """
    beyond = max(float(np.abs(s).max()) * h - math.pi, 0.0)
    count = _NODES + math.ceil(_NODES_PER_RADIAN * beyond)
    nodes, weights = np.polynomial.legendre.leggauss(count)
    t, weights = 0.5 * h * (nodes + 1.0), 0.5 * h * weights
    x = np.outer(s, t)
    one, two = phi(1, x), phi(2, x)
    back = np.exp(np.outer(s, t - h))
    constant = scale * t * one
    linear = scale * t * (2.0 * t / h * two - one)
    tilt = 1.0 + 1j * rho

    def speed(z: np.ndarray, drive: np.ndarray | float = 1.0) -> np.ndarray:
        return np.asarray((tilt * z).real * np.atleast_1d(drive)[:, None])

    moves = {
        "R": speed(back), "I": speed(1j * back), "0": speed(constant, drive_c),
        "1": speed(linear, drive_c), "A": speed(constant, drive_a),
    }  # fmt: skip
    factor = 4.0 * rho * s.imag * energy

    def product(a: str, b: str) -> np.ndarray:
        twice = 1.0 if a == b else 2.0
        return np.asarray(twice * factor * ((moves[a] * moves[b]) @ weights))

    columns = {
        k.LOSS_RR: product("R", "R"), k.LOSS_RI: product("R", "I"), k.LOSS_II: product("I", "I"),
        k.LOSS_R0: product("R", "0"), k.LOSS_I0: product("I", "0"),
        k.LOSS_R1: product("R", "1"), k.LOSS_I1: product("I", "1"),
        k.LOSS_RA: product("R", "A"), k.LOSS_IA: product("I", "A"),
    }  # fmt: skip
    sums = {
        solve.LOSS_00: product("0", "0"),
        solve.LOSS_01: product("0", "1"),
        solve.LOSS_11: product("1", "1"),
        solve.LOSS_0A: product("0", "A"),
        solve.LOSS_1A: product("1", "A"),
        solve.LOSS_AA: product("A", "A"),
    }
    return columns, {key: float(np.sum(value)) for key, value in sums.items()}


class CollocationPlant(Plant):
    """The default scheme `modal`: order 4, energy to rounding, driven by its kernels' `step`."""

    scheme = "modal"
    kernels: Any = k

    def _build_model(self) -> k.CollocationModel:
        return build_model(self.spec, self.modes)

    def _empty_state(self) -> k.CollocationState:
        modes = self.model.table.shape[1]
        state = k.CollocationState(
            z=np.zeros((2, modes)),
            free=np.zeros((2, modes)),
            body=np.zeros(k.BODY_SIZE),
            books=np.zeros(pk.BOOKS_SIZE),
            counts=np.zeros(pk.COUNTS_SIZE, np.int64),
        )
        state.counts[pk.ROWS] = modes
        return state

    def contact_energy_j(self) -> float:
        """Energy stored in the contact and the spring of the modes left out, J."""
        return float(self.state.body[k.STORED])
