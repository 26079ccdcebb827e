"""The actuator between the controller's line and the plate: bandwidth, mass and limit."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hertzloop.plant.actuator_kernels import ActuatorModel
from hertzloop.plant.structures.modes import Oscillators

_NO_SHAPE = 1e-9  # of the largest at the actuator: such a mode does not feel the mass
_CHUNK = 2**16  # numbers of a work array: larger ones cost more page faults than arithmetic
_MOST_HALVINGS = 200
_SERIES_TERMS = 15  # 1/17! of 1 is below rounding


@dataclass(frozen=True)
class Actuator:
    """Second order up to `bandwidth_hz` with `damping` (of critical; without a bandwidth it
    follows at once), a mass that moves with the plate, and the largest force (N; None: any)."""

    bandwidth_hz: float | None = None
    damping: float = 0.7
    mass_kg: float = 0.0
    force_limit_n: float | None = None

    @cached_property
    def ideal(self) -> bool:
        """Whether every command acts on the plate unchanged."""
        follows = self.bandwidth_hz is None and self.force_limit_n is None
        return follows and self.mass_kg == 0.0

    @cached_property
    def delay_s(self) -> float:
        """Delay of a slow command, 2 zeta/w, s."""
        if self.bandwidth_hz is None:
            return 0.0
        return 2.0 * self.damping / (2.0 * math.pi * self.bandwidth_hz)


IDEAL = Actuator()


def build_model(actuator: Actuator, step_s: float) -> ActuatorModel:
    """Coefficients of one step; the mass is part of the plate's modes, see `mass_loaded`."""
    limit = math.inf if actuator.force_limit_n is None else float(actuator.force_limit_n)
    if actuator.bandwidth_hz is None:
        return ActuatorModel(True, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, limit)
    zeta = actuator.damping
    turn = 2.0 * math.pi * actuator.bandwidth_hz * step_s
    (p0, q0), (p1, q1), (p2, q2) = _phis(turn, zeta)
    return ActuatorModel(
        at_once=False,
        turn_ff=p0,
        turn_fd=q0 * turn,
        turn_df=-q0 * turn,
        turn_dd=p0 - 2.0 * zeta * turn * q0,
        mean_f=p1,
        mean_d=q1 * turn,
        slope_f=3.0 * (p1 - 2.0 * p2),
        slope_d=3.0 * (q1 - 2.0 * q2) * turn,
        limit_n=limit,
    )


def _phis(turn: float, zeta: float) -> tuple[tuple[float, float], ...]:
    """phi_0, phi_1 and phi_2 of A = turn [[0, 1], [-1, -2 zeta]]; (p, q) stands for p + q A.

    The series of phi_2 for A/2^n, where it is small, then phi_2(2 A) = (phi_1(A)^2 + 2 phi_2(A))/4
    n times, phi_k = 1/k! + A phi_(k+1). No linear algebra: its last bits depend on the processor.
    """
    halvings = 0
    while turn * (1.0 + zeta) > 0.5:
        turn, halvings = 0.5 * turn, halvings + 1
    square, double = turn * turn, 2.0 * zeta * turn  # A^2 = -square - double A
    p = q = 0.0
    for k in range(_SERIES_TERMS, -1, -1):
        p, q = 1.0 / math.factorial(k + 2) - square * q, p - double * q
    for _ in range(halvings):
        p1, q1 = 1.0 - square * q, p - double * q
        p = 0.25 * (p1 * p1 - square * q1 * q1 + 2.0 * p)
        q = 0.125 * (2.0 * p1 * q1 - double * q1 * q1 + 2.0 * q)
        square, double = 4.0 * square, 2.0 * double
    first = 1.0 - square * q, p - double * q
    return (1.0 - square * first[1], first[0] - double * first[1]), first, (p, q)


@dataclass(frozen=True)
class LinearActuator:
    """An actuator as a linear system: x' = a x + b c from step to step under a command c.

    Attributes:
        a: of the state, shape (n, n); b: of the command, shape (n,).
        state: of the mean force of a step and half its rise, shape (2, n).
        command: of these, shape (2,).
    """

    a: np.ndarray
    b: np.ndarray
    state: np.ndarray
    command: np.ndarray


def linear_form(model: ActuatorModel) -> LinearActuator:
    """Return an actuator as a linear system, within its force limit; without a bandwidth it has no
    state."""
    if model.at_once:
        none = np.zeros(0)
        return LinearActuator(np.zeros((0, 0)), none, np.zeros((2, 0)), np.array([1.0, 0.0]))
    turn = np.array([[model.turn_ff, model.turn_fd], [model.turn_df, model.turn_dd]])
    seen = np.array([[model.mean_f, model.mean_d], [model.slope_f, model.slope_d]])
    # The state is F - c and its rate, so a command moves it by what it takes from F.
    command = np.array([1.0, 0.0])
    return LinearActuator(turn, command - turn[:, 0], seen, command - seen[:, 0])


def mass_loaded(
    modes: Oscillators, mass_kg: float, flexibility_m_n: float, same: bool
) -> Oscillators:
    """Oscillators of the plate with a mass on it at the actuator.

    `flexibility_m_n`: of the modes left out, a spring between mass and plate; `same`: the actuator
    is at the contact point. A sensor keeps its place on the plate. The frequencies are the roots
    W = w^2 of the secular equation sum_k g_k/(w_k^2 - W) + R = 1/(m W), g_k = lambda Phi_a^2: one
    below each w_k and, with a spring, one above the last. The modes' masses include that on the
    plate, so nothing else changes.
    """
    pole, at_contact, at_actuator, at_sensor = _apart(modes)
    scale_per_kg = modes.scale_per_kg
    felt = np.abs(at_actuator) > _NO_SHAPE * np.abs(at_actuator).max(initial=0.0)
    if not np.any(felt):
        return modes
    weight = np.concatenate([[1.0 / mass_kg], scale_per_kg * at_actuator[felt] ** 2])
    poles = np.concatenate([[0.0], pole[felt]])
    origin, offset = _roots(poles, weight, flexibility_m_n)
    squared = poles[origin] + offset
    reach = 1.0 / (mass_kg * squared)  # displacement of the mass by a unit force on the plate
    contact, size = np.empty_like(squared), np.empty_like(squared)
    sensor = None if at_sensor is None else np.empty_like(squared)
    drive = scale_per_kg * at_contact[felt] * at_actuator[felt]
    rows = max(1, _CHUNK // len(poles))
    for i in range(0, len(squared), rows):
        part = slice(i, i + rows)
        away = (poles - poles[origin[part], None]) - offset[part, None]
        size[part] = np.sum(weight / away**2, axis=1)
        contact[part] = np.sum(drive / away[:, 1:], axis=1)
        if sensor is not None and at_sensor is not None:
            seen = scale_per_kg * at_sensor[felt] * at_actuator[felt]
            sensor[part] = np.sum(seen / away[:, 1:], axis=1)
    unit = np.sqrt(size * scale_per_kg)
    actuator = reach / unit
    contact = actuator if same else contact / unit
    omega = np.concatenate([np.sqrt(squared), np.sqrt(pole[~felt])])
    order = np.argsort(omega, kind="stable")
    if sensor is not None and at_sensor is not None:
        sensor = np.concatenate([sensor / unit, at_sensor[~felt]])[order]
    return replace(
        modes,
        sensor=sensor,
        omega=omega[order],
        contact=np.concatenate([contact, at_contact[~felt]])[order],
        actuator=np.concatenate([actuator, at_actuator[~felt]])[order],
    )


def _apart(
    modes: Oscillators,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """w^2 and all shapes, two oscillators of one frequency turned so that one of them only
    moves the actuator."""
    contact, actuator = modes.contact.copy(), modes.actuator.copy()
    first = np.flatnonzero(np.diff(modes.omega) == 0.0)
    second = first + 1
    size = np.hypot(actuator[first], actuator[second])
    turns = size > 0.0
    first, second, size = first[turns], second[turns], size[turns]
    sensor = None if modes.sensor is None else modes.sensor.copy()
    for shape in (contact, sensor):
        if shape is not None:
            one, other = shape[first], shape[second]
            shape[first] = (one * actuator[first] + other * actuator[second]) / size
            shape[second] = (other * actuator[first] - one * actuator[second]) / size
    actuator[first], actuator[second] = size, 0.0
    return modes.omega**2, contact, actuator, sensor


def _roots(
    poles: np.ndarray, weights: np.ndarray, constant: float
) -> tuple[np.ndarray, np.ndarray]:
    """Roots of sum weights/(poles - W) + constant, as the pole next to each and the way from
    it: one between neighbours, one above the last if `constant` > 0. Poles ascend.

    The sum rises from pole to pole. Times the way from the near pole it is smooth: Newton
    inside a bracket, halved where Newton leaves it.
    """
    upper = poles[1:]
    if constant > 0.0:
        upper = np.append(upper, poles[-1] + weights.sum() / constant)
    lower = poles[: len(upper)]
    origin, offset = np.empty(len(upper), np.int64), np.empty(len(upper))
    rows = max(1, _CHUNK // len(poles))
    for i in range(0, len(upper), rows):
        part = slice(i, i + rows)
        number = np.arange(len(upper))[part]
        width = upper[part] - lower[part]
        away = (poles - poles[number, None]) - (0.5 * width)[:, None]
        half = np.sum(weights / away, axis=1) + constant
        left = (half > 0.0) | (number + 1 == len(poles))
        near = np.where(left, number, np.minimum(number + 1, len(poles) - 1))
        low = np.where(left, 0.0, -0.5 * width)
        # Above the last pole the only neighbour is far away.
        high = np.where(left, np.where(half > 0.0, 0.5 * width, width), 0.0)
        origin[part], offset[part] = near, _offsets(poles, weights, constant, near, low, high)
    return origin, offset


def _offsets(
    poles: np.ndarray,
    weights: np.ndarray,
    constant: float,
    near: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Ways from the near poles inside their brackets, to rounding."""
    away_0 = poles - poles[near, None]
    others = np.where(np.arange(len(poles)) == near[:, None], 0.0, weights)
    away_0[np.arange(len(near)), near] = np.inf
    own = weights[near]
    found, way = np.empty(len(near)), 0.5 * (low + high)
    open_ = np.arange(len(near))  # few roots need many rounds: the others are not repeated
    for _ in range(_MOST_HALVINGS):
        away = away_0 - way[:, None]
        rest = np.sum(others / away, axis=1) + constant
        slope = np.sum(others / away**2, axis=1)
        value = own - way * rest  # -way times the whole sum
        rises = value / way < 0.0  # the whole sum is above zero
        high, low = np.where(rises, way, high), np.where(rises, low, way)
        trial = way + value / (rest + way * slope)
        new = np.where((trial >= low) & (trial <= high), trial, 0.5 * (low + high))
        found[open_] = new
        goes_on = ~(np.abs(new - way) <= 1e-15 * np.abs(way))
        if not np.any(goes_on):
            break
        open_, way, low, high = (a[goes_on] for a in (open_, new, low, high))
        if not np.all(goes_on):
            away_0, others, own = (a[goes_on] for a in (away_0, others, own))
    return found
