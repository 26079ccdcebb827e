"""The default scheme `modal`: coefficients of the energy-preserving collocation step."""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from hertzloop.plant import actuator
from hertzloop.plant.contact import elastic_kernels as elastic
from hertzloop.plant.contact.residual_mode_kernels import ResidualMode
from hertzloop.plant.contact.yielding import yielding
from hertzloop.plant.numerics import damped_frequency, phi
from hertzloop.plant.one_thread import gauss, on_one_thread
from hertzloop.plant.plant import Plant, PlantSpec, common_fields
from hertzloop.plant.schemes import collocation_kernels
from hertzloop.plant.state_kernels import AWAKE, BALANCE_SIZE, COUNTS_SIZE, CURVE, DEEPEST
from hertzloop.plant.structures.modes import Oscillators

_TAIL_NODES = 24  # of the time integral of the loss, for a turn of up to pi in a step
_TAIL_NODES_PER_RADIAN = 0.75
_LINE = 8  # numbers in a line of the processor's cache


# The modes left out of a plate, as one damped mode in place of a massless spring.
#
# Above the highest mode taken along, w_c, a plate is a continuum of mobility Y; below it, what
# that continuum adds is j (Y/pi) ln((w_c + w)/(w_c - w)). The passive fit with the exact terms in
# w and w^3, no loss in w^2 and Y at infinity is, with q = j w,
#
#     Y_t = Y q (q + 6 w_c/pi)/(q^2 + (pi/2) w_c q + 3 w_c^2),
#
# one complex mode. Its real part is Y w^4/|q^2 + ...|^2: with y'' + (pi/2) w_c y' + 3 w_c^2 y = F
# it loses the power Y y''^2 and holds
# Y ((3/pi + pi/4) w_c y'^2 + 3 w_c^2 y y' + (9/pi) w_c^3 y^2).


def residual_limit(mobility_m_ns: float, flexibility_m_n: float) -> float:
    """w_c (rad/s) at which the mode is as flexible as the modes left out, 2 Y/(pi w_c)."""
    return 2.0 * mobility_m_ns / (math.pi * flexibility_m_n)


def build_residual_mode(
    mobility_m_ns: float, omega_c: float, step_s: float, same_point: bool
) -> tuple[ResidualMode, dict[int, float]]:
    """Coefficients of a step, and what the mode adds to the model's gains, index: value."""
    h, y = step_s, mobility_m_ns
    a = 0.25 * math.pi * omega_c
    b = math.sqrt(3.0 * omega_c**2 - a * a)
    s = complex(-a, b)
    drive = complex(y * (6.0 * omega_c / math.pi - a) / b, y)
    x = np.array([s * h])
    turn, one, two, three = (complex(phi(i, x)[0]) for i in range(4))
    constant, linear = h * one * drive, h * s * h * (2.0 * three - two) * drive
    mean_constant, mean_linear = h * two * drive, h * (2.0 * three - two) * drive
    # y and y' from displacement Im z and velocity Im(s z), so from Re z and Im z.
    by_y = y * np.array(
        [
            [6.0 * omega_c / math.pi, 1.0],
            [-3.0 * omega_c**2, (6.0 / math.pi - 0.5 * math.pi) * omega_c],
        ]
    )
    to_y = np.linalg.solve(by_y, np.array([[0.0, 1.0], [b, -a]]))
    held = y * np.array(
        [
            [9.0 / math.pi * omega_c**3, 1.5 * omega_c**2],
            [1.5 * omega_c**2, (3.0 / math.pi + 0.25 * math.pi) * omega_c],
        ]
    )
    energy = to_y.T @ held @ to_y
    residual_mode = ResidualMode(
        turn_re=turn.real,
        turn_im=turn.imag,
        by_0_re=constant.real,
        by_0_im=constant.imag,
        by_1_re=linear.real,
        by_1_im=linear.imag,
        speed_re=b,
        speed_im=-a,
        mean_re=one.imag,
        mean_im=one.real,
        mobility_m_ns=y,
        energy=np.array([energy[0, 0], 2.0 * energy[0, 1], energy[1, 1]]),
        lost=_lost(y, omega_c, s, drive, h, to_y),
    )
    gains = {
        elastic.PX0: constant.imag,
        elastic.PX1: linear.imag,
        elastic.PV0: (s * constant).imag + y,
        elastic.PV1: (s * linear).imag + y,
        elastic.PM0: mean_constant.imag,
        elastic.PM1: mean_linear.imag,
        elastic.START0: y,
        elastic.START1: -y,
    }
    if same_point:
        gains |= {
            elastic.CA: gains[elastic.PX0],
            elastic.VA: gains[elastic.PV0],
            elastic.MA: gains[elastic.PM0],
            elastic.CA1: gains[elastic.PX1],
            elastic.VA1: gains[elastic.PV1],
            elastic.MA1: gains[elastic.PM1],
        }
    return residual_mode, gains


def _lost(
    y: float, omega_c: float, s: complex, drive: complex, h: float, to_y: np.ndarray
) -> np.ndarray:
    """Y times the integral of y''^2 over a step: coefficients by z at the end without force, F_0
    and F_1, upper triangle row by row."""
    count = _TAIL_NODES + math.ceil(_TAIL_NODES_PER_RADIAN * max(abs(s) * h - math.pi, 0.0))
    nodes, weights = gauss(count)
    t, weights = 0.5 * h * (nodes + 1.0), 0.5 * h * weights
    one, two = phi(1, s * t), phi(2, s * t)
    back = np.exp(s * (t - h))
    rise = 2.0 * t / h - 1.0
    z = np.stack([back, 1j * back, drive * t * one, drive * t * (2.0 * t / h * two - one)])
    force = np.stack([np.zeros_like(t), np.zeros_like(t), np.ones_like(t), rise])
    value, rate = (row[0] * z.real + row[1] * z.imag for row in to_y)
    bend = force - 0.5 * math.pi * omega_c * rate - 3.0 * omega_c**2 * value
    full = y * (bend * weights) @ bend.T
    upper = np.triu(full) + np.triu(full, 1)
    return np.asarray(upper[np.triu_indices(4)])


def aligned(values: np.ndarray) -> np.ndarray:
    """A copy of an array of floats, C-contiguous, at the start of a cache line.

    Elsewhere, which is where NumPy puts large ones, every vector of eight would be read from two
    lines, and how fast a run is would depend on where its arrays happened to lie.
    """
    room = np.empty(values.size + _LINE)
    address = room.__array_interface__["data"][0]  # `ctypes` takes longer
    first = -(address // room.itemsize) % _LINE
    placed = room[first : first + values.size].reshape(values.shape)
    placed[...] = values
    return placed


def build_model(spec: PlantSpec, modes: Oscillators) -> collocation_kernels.CollocationModel:
    """Coefficients of one step for every oscillator."""
    h, m = spec.step_s, spec.sphere.mass_kg
    scale = modes.scale_per_kg
    theta, rho = damped_frequency(modes.omega, modes.eta)
    s = (-rho + 1j) * theta
    x = s * h
    turn, one, two, three = (phi(i, x) for i in range(4))
    constant = scale * h * one  # change of z by a unit force, by a unit P(t)
    linear = scale * h * x * (2.0 * three - two)
    mean_constant = scale * h * two  # their shares of the mean over the step
    mean_linear = scale * h * (2.0 * three - two)
    same = spec.same_point
    b_c, b_a = modes.contact, modes.actuator
    drive_c, drive_a = (b_c * b_c,) * 2 if same else (b_c, b_a)
    weight_c, weight_a = (np.ones_like(b_c),) * 2 if same else (b_c, b_a)

    def moves(weight: np.ndarray, drive: np.ndarray, z: np.ndarray) -> float:
        return float(np.sum(weight * drive * z.imag / theta))

    def speeds(drive: np.ndarray, z: np.ndarray) -> float:
        return float(np.sum(weight_c * drive * (z.real - rho * z.imag)))

    gains = np.zeros(elastic.GAINS)
    # By each force: displacement, velocity, mean at the contact, displacement and mean beside it.
    held, risen = (constant, mean_constant), (linear, mean_linear)
    for drive, (by, mean), (at_x, at_v, at_mean, at_y, at_y_mean) in (
        (drive_c, held, (elastic.PX0, elastic.PV0, elastic.PM0, elastic.AC0, elastic.MAC0)),
        (drive_c, risen, (elastic.PX1, elastic.PV1, elastic.PM1, elastic.AC1, elastic.MAC1)),
        (drive_a, held, (elastic.CA, elastic.VA, elastic.MA, elastic.AA, elastic.MAA)),
        (drive_a, risen, (elastic.CA1, elastic.VA1, elastic.MA1, elastic.AA1, elastic.MAA1)),
    ):
        gains[at_x], gains[at_v] = moves(weight_c, drive, by), speeds(drive, by)
        gains[at_mean] = moves(weight_c, drive, mean)
        gains[at_y], gains[at_y_mean] = moves(weight_a, drive, by), moves(weight_a, drive, mean)
    residual_mode, of_residual = damped_residual(spec)
    flexibility = flexibility_m_n(spec)
    for index, share in of_residual.items():
        gains[index] += share
    elastic.add_sphere(gains, h, m)
    # Oscillators are sorted by frequency. `swing` is for modes of one rho.
    slow = int(np.searchsorted(theta * h, _SLOW)) if isinstance(rho, float) else len(theta)
    gains[elastic.SWING0], gains[elastic.SWING1] = (
        np.sum((drive_c * (z.real + rho * z.imag) / theta**2)[slow:]) for z in (constant, linear)
    )
    if isinstance(rho, float):
        gains[elastic.MEAN_BY_SWING] = -1.0 / (h * (1.0 + rho * rho))

    # Means from z at the end of a step without force: phi_1(x)/e^x = phi_1(-x).
    back = phi(1, -x)
    columns = {
        collocation_kernels.ROT_RE: turn.real,
        collocation_kernels.ROT_IM: turn.imag,
        collocation_kernels.C0_RE: drive_c * constant.real,
        collocation_kernels.C0_IM: drive_c * constant.imag,
        collocation_kernels.C1_RE: drive_c * linear.real,
        collocation_kernels.C1_IM: drive_c * linear.imag,
        collocation_kernels.OUT: weight_c / theta,
        collocation_kernels.MEAN_RE: back.real * weight_c / theta,
        collocation_kernels.MEAN_IM: back.imag * weight_c / theta,
        collocation_kernels.THETA: theta,
        collocation_kernels.A_RE: drive_a * constant.real,
        collocation_kernels.A_IM: drive_a * constant.imag,
        collocation_kernels.B_C: weight_c,
        collocation_kernels.B_A: weight_a / theta,
        collocation_kernels.A1_RE: drive_a * linear.real,
        collocation_kernels.A1_IM: drive_a * linear.imag,
        collocation_kernels.MEAN_A_RE: back.real * weight_a / theta,
        collocation_kernels.MEAN_A_IM: back.imag * weight_a / theta,
        collocation_kernels.ENERGY: 1.0
        / (2.0 * scale * (b_c * b_c if same else np.ones_like(b_c))),
    }
    damped = bool(np.any(np.asarray(modes.eta) > 0.0))
    if damped:
        energy = columns[collocation_kernels.ENERGY]
        lost, sums = _losses(s, rho, h, scale, energy, drive_c, drive_a)
        columns |= lost
        for index, value in sums.items():
            gains[index] = np.sum(value)
    table = aligned(
        np.stack([columns.get(i, np.zeros_like(theta)) for i in range(collocation_kernels.COLUMNS)])
    )
    return collocation_kernels.CollocationModel(
        step_s=h,
        flexibility_m_n=flexibility,
        same_point=same,
        damped=damped,
        rho=rho,
        slow=slow,
        actuator=actuator.build_model(spec.actuator, h),
        residual_mode=residual_mode,
        probe=_probe(modes, same, rho, drive_c, drive_a, constant, linear),
        gains=gains,
        table=table,
        **_of_contact(spec),
    )


def _of_contact(spec: PlantSpec) -> dict[str, Any]:
    """The fields of a model that sphere and contact decide, but for its gains."""
    contact = spec.contact
    law = None if contact.limit is None else yielding(contact.limit, contact.stiffness)
    return common_fields(spec) | {"law": law}


def _probe(
    modes: Oscillators,
    same: bool,
    rho: float | np.ndarray,
    drive_c: np.ndarray,
    drive_a: np.ndarray,
    constant: np.ndarray,
    linear: np.ndarray,
) -> collocation_kernels.Probe | None:
    """How a sensor elsewhere sees the oscillators, None of one at the contact; `constant` and
    `linear`: change of z by unit forces."""
    if modes.sensor is None:
        return None
    weight = modes.sensor / modes.contact if same else modes.sensor

    def by(drive: np.ndarray, z: np.ndarray) -> float:
        return float(np.sum(weight * drive * (z.real - rho * z.imag)))

    return collocation_kernels.Probe(
        aligned(weight),
        by(drive_c, constant),
        by(drive_c, linear),
        by(drive_a, constant),
        by(drive_a, linear),
    )


def with_contact(
    model: collocation_kernels.CollocationModel, spec: PlantSpec
) -> collocation_kernels.CollocationModel:
    """Return the model of the same structure with the sphere and the contact of `spec`.

    The result has the same bits as `build_model`, in a fraction of the time: the columns of the
    modes are shared.
    """
    gains = model.gains.copy()
    elastic.add_sphere(gains, spec.step_s, spec.sphere.mass_kg)
    return model._replace(gains=gains, **_of_contact(spec))


def flexibility_m_n(spec: PlantSpec) -> float:
    """Spring that stands for the modes left out, m/N; zero if the description has none."""
    return 0.0 if spec.damped_residual else residual_m_n(spec)


@lru_cache(maxsize=64)
def damped_residual(spec: PlantSpec) -> tuple[ResidualMode | None, dict[int, float]]:
    """The mode that stands for the modes left out, and what it adds to gains; see
    `build_residual_mode`. Cached, since metrics of every impact ask for it."""
    left_out = residual_m_n(spec) if spec.damped_residual else 0.0
    if left_out == 0.0:
        return None, {}
    mobility = 1.0 / spec.local_plate.infinite_plate_impedance_n_s_m
    return build_residual_mode(
        mobility, residual_limit(mobility, left_out), spec.step_s, spec.same_point
    )


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


_SLOW = 0.02  # of w h; the difference of two `swing` loses as many digits as this has
_NODES = 24  # of the time integral while no mode turns by more than pi in a step
_NODES_PER_RADIAN = 0.75  # more for the turn beyond; Gauss's rule needs half a node a radian


@on_one_thread
def _losses(
    s: np.ndarray,
    rho: float | np.ndarray,
    h: float,
    scale: float,
    energy: np.ndarray,
    drive_c: np.ndarray,
    drive_a: np.ndarray,
) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
    """Energy that damped oscillators lose in a step, 2 delta m times the integral of v^2: columns
    of the table, and terms that are summed into gains, by their indices.

    v is linear in z at the end of the step without forces, and in F_0, F_1, F_a, each of which
    moves the mass from rest in a known way; the coefficients of all products are integrated
    by Gauss's rule. (The closed form is a difference of large numbers for slow modes.)
    """
    beyond = max(float(np.abs(s).max()) * h - math.pi, 0.0)
    count = _NODES + math.ceil(_NODES_PER_RADIAN * beyond)
    nodes, weights = gauss(count)
    t, weights = 0.5 * h * (nodes + 1.0), 0.5 * h * weights
    x = np.outer(s, t)
    one, two = phi(1, x), phi(2, x)
    back = np.exp(np.outer(s, t - h))
    constant = scale * t * one
    linear = scale * t * (2.0 * t / h * two - one)
    tilt = 1.0 + 1j * (rho if isinstance(rho, float) else rho[:, None])

    def speed(z: np.ndarray, drive: np.ndarray | float = 1.0) -> np.ndarray:
        return np.asarray((tilt * z).real * np.atleast_1d(drive)[:, None])

    moves = {
        "R": speed(back),
        "I": speed(1j * back),
        "0": speed(constant, drive_c),
        "1": speed(linear, drive_c),
    }
    alike = {"A": "0", "B": "1"} if drive_a is drive_c else {}  # both forces at one point
    if not alike:
        moves |= {"A": speed(constant, drive_a), "B": speed(linear, drive_a)}
    factor = 4.0 * rho * s.imag * energy
    integrals: dict[tuple[str, str], np.ndarray] = {}

    def product(a: str, b: str) -> np.ndarray:
        twice = 1.0 if a == b else 2.0
        one, other = sorted((alike.get(a, a), alike.get(b, b)))
        if (one, other) not in integrals:
            integrals[one, other] = (moves[one] * moves[other]) @ weights
        return np.asarray(twice * factor * integrals[one, other])

    columns = {
        collocation_kernels.LOSS_RR: product("R", "R"),
        collocation_kernels.LOSS_RI: product("R", "I"),
        collocation_kernels.LOSS_II: product("I", "I"),
        collocation_kernels.LOSS_R0: product("R", "0"),
        collocation_kernels.LOSS_I0: product("I", "0"),
        collocation_kernels.LOSS_R1: product("R", "1"),
        collocation_kernels.LOSS_I1: product("I", "1"),
        collocation_kernels.LOSS_RA: product("R", "A"),
        collocation_kernels.LOSS_IA: product("I", "A"),
        collocation_kernels.LOSS_RB: product("R", "B"),
        collocation_kernels.LOSS_IB: product("I", "B"),
    }
    sums = {
        elastic.LOSS_00: product("0", "0"),
        elastic.LOSS_01: product("0", "1"),
        elastic.LOSS_11: product("1", "1"),
        elastic.LOSS_0A: product("0", "A"),
        elastic.LOSS_1A: product("1", "A"),
        elastic.LOSS_AA: product("A", "A"),
        elastic.LOSS_0B: product("0", "B"),
        elastic.LOSS_1B: product("1", "B"),
        elastic.LOSS_AB: product("A", "B"),
        elastic.LOSS_BB: product("B", "B"),
    }
    return columns, sums


class CollocationPlant(Plant):
    """The default scheme `modal`: order 4, energy to rounding, driven by its kernels' `step`."""

    kernels: Any = collocation_kernels

    def _build_model(self) -> collocation_kernels.CollocationModel:
        return build_model(self.spec, self.modes)

    def _empty_state(self) -> collocation_kernels.CollocationState:
        modes = self.model.table.shape[1]
        state = collocation_kernels.CollocationState(
            z=aligned(np.zeros((2, modes))),
            free=aligned(np.zeros((2, modes))),
            body=np.zeros(collocation_kernels.BODY_SIZE),
            balance=np.zeros(BALANCE_SIZE),
            counts=np.zeros(COUNTS_SIZE, np.int64),
        )
        state.counts[AWAKE] = modes
        law = self.model.law
        if law is not None:
            state.body[DEEPEST], state.body[CURVE] = law.delta_m, self.model.stiffness
        return state
