"""The scheme `thesis2008`: sampled Green's functions, and a plant that is driven like `modal`.

See `thesis2008_kernels` for the numerics. They conserve neither momentum nor energy; the
books say by how much.
"""

import math
from functools import lru_cache

import numpy as np

from plant.books import Books, balance
from plant.contact.hertz import GRAVITY_M_S2, Contact, Damping
from plant.one_thread import on_one_thread
from plant.plant import PlantSpec
from plant.schemes import state_kernels as pk
from plant.schemes import thesis2008_kernels as k
from plant.structures.plate import Oscillators, Plate, oscillators

NEWTON_ALLOWED = 30_000_000  # the published runs needed up to 22,942,400
_BLOCK = 256
_MODES_AT_ONCE, _PAIRS_AT_ONCE = 1 << 16, 1 << 23


def green_functions(
    plate: Plate, modes: Oscillators, step_s: float, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement, velocity and acceleration at the struck point after a unit impulse there.

    Sampled at 0, dt, 2 dt ..., shape (count,), in m, m/s, m/s^2 per N s; the acceleration's
    first value is zero, as published. g(t) = lambda sum Phi^2 sin(Theta t)/Theta e^(-delta t).
    """
    eta = plate.eta
    theta = modes.omega * math.sqrt(1.0 - eta * eta / 4.0)
    s = theta * (1j - (eta / 2.0) / math.sqrt(1.0 - eta * eta / 4.0))
    weight = plate.modal_scale_per_kg * modes.contact**2 / theta
    total = np.zeros((3, -(-count // _BLOCK), _BLOCK))
    # A mode and a time at most so often at once: all pairs would not fit for a large plate.
    for first in range(0, len(s), _MODES_AT_ONCE):
        some = slice(first, first + _MODES_AT_ONCE)
        _add_modes(total, s[some], weight[some], step_s)
    sampled = total.reshape(3, -1)[:, :count].copy()
    sampled[2, 0] = 0.0
    return sampled[0], sampled[1], sampled[2]


@on_one_thread
def _add_modes(total: np.ndarray, s: np.ndarray, weight: np.ndarray, step_s: float) -> None:
    """Add modes of exponents `s` to the three functions, shape (3, blocks, _BLOCK)."""
    inside = np.exp(np.outer(s, np.arange(_BLOCK) * step_s))
    rows = max(1, _PAIRS_AT_ONCE // len(s))
    for first in range(0, total.shape[1], rows):
        blocks = np.arange(first, min(first + rows, total.shape[1]))
        starts = np.exp(np.outer(blocks * _BLOCK * step_s, s))
        for function, factor in zip(total, (np.ones_like(s), s, s * s), strict=True):
            function[blocks] += ((starts * (weight * factor)) @ inside).imag


@lru_cache(maxsize=32)
def sampled(
    plate: Plate, point_m: tuple[float, float], step_s: float, count: int
) -> tuple[Oscillators, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Modes up to pi/dt, as published, and their Green's functions."""
    modes = oscillators(plate, point_m, point_m, math.pi / step_s)
    return modes, green_functions(plate, modes, step_s, count)


def relative_speed_m_s(xi: np.ndarray, impact_speed_m_s: float, step_s: float) -> float:
    """Relative velocity at the last of a contact's samples xi (m), of which the first is 0.

    xi1 - xi0 = f (dt v0 + dt^2 ((1/2 - beta) a0 + beta a1)) and v1 - v0 = f dt ((1 - gamma) a0
    + gamma a1) give a1 and v1 one after the other; errors die out by a factor of 4 a sample.
    """
    v, a = -impact_speed_m_s, -GRAVITY_M_S2
    for change in np.diff(xi).tolist():
        advanced = change / (k.ADVANCE * step_s) - v
        a1 = (advanced / step_s - (0.5 - k.BETA) * a) / k.BETA
        v += k.ADVANCE * step_s * ((1.0 - k.GAMMA) * a + k.GAMMA * a1)
        a = a1
    return v


class ThesisPlant:
    """Model and state of the published scheme, for a run of at most `steps` steps.

    Raises ValueError when the actuator does not push at the struck point, or when contact
    damping is Hunt-Crossley's: the published scheme has neither.
    """

    scheme = "thesis2008"

    def __init__(self, spec: PlantSpec, steps: int, most_iterations: int = NEWTON_ALLOWED) -> None:
        if not spec.same_point:
            raise ValueError(
                f"actuator_point_m = {list(spec.actuator_point_m)} is not the struck point; the "
                "scheme thesis2008 knows a force at the struck point only"
            )
        self.spec = spec
        self.modes, (green_x, green_v, green_a) = sampled(
            spec.simply_supported, spec.contact_point_m, spec.step_s, steps + 2
        )
        contact = spec.contact
        self.model = k.ThesisModel(
            step_s=spec.step_s,
            mass_kg=spec.sphere.mass_kg,
            gravity_m_s2=GRAVITY_M_S2,
            stiffness=contact.stiffness,
            damping=_damping(contact),
            viscous_n_s_m=contact.viscous_n_s_m,
            relaxation_stiffness=contact.relaxation_stiffness,
            relaxation_s=contact.relaxation_s,
            most_iterations=most_iterations,
            same_point=True,
            green_x=green_x,
            green_v=green_v,
            green_a=green_a,
        )
        self.state = self._initial_state(steps)

    def _initial_state(self, steps: int) -> k.ThesisState:
        memory = steps + 2 if self.model.damping != k.VISCOUS else 0
        decay_s = self.model.relaxation_s or 1.0
        state = k.ThesisState(
            body=np.zeros(pk.BODY_SIZE),
            books=np.zeros(pk.BOOKS_SIZE),
            counts=np.zeros(k.COUNTS_SIZE, np.int64),
            motion=np.zeros(k.MOTION_SIZE),
            total=np.zeros(steps + 2),
            undamped=np.zeros(steps + 2),
            depth=np.zeros(steps + 2),
            decay=np.exp(-np.arange(memory) * self.model.step_s / decay_s),
        )
        speed, h = self.spec.sphere.impact_speed_m_s, self.model.step_s
        lead = round(min(self.spec.lead_in_s, speed / GRAVITY_M_S2) / h)
        state.counts[k.NEXT_IMPACT] = lead
        state.body[pk.FLIGHT_V] = -speed
        if lead:
            state.body[pk.FLIGHT_X] = lead * h * (speed - 0.5 * GRAVITY_M_S2 * lead * h)
            state.body[pk.FLIGHT_V] = GRAVITY_M_S2 * lead * h - speed
            state.body[pk.XI] = state.body[pk.XI_S] = state.body[pk.FLIGHT_X]
        else:
            k.begin_impact(self.model, state, 0, speed)
        self._start = state.body[[pk.FLIGHT_X, pk.FLIGHT_V]].copy()
        return state

    def sphere_speed_m_s(self) -> float:
        """Speed of the sphere at the present step, up positive."""
        body, counts = self.state.body, self.state.counts
        if counts[k.TOUCHING]:
            return float(self.state.motion[k.REL_V] + body[pk.V_P])
        flight_s = (counts[pk.STEP] - counts[pk.FLIGHT_STEP]) * self.model.step_s
        return float(body[pk.FLIGHT_V] - GRAVITY_M_S2 * flight_s)

    def close_books(self) -> Books:
        """Balance of the run. `modal_dissipated_j` is all work on the plate: the published
        numerics have no energy of the plate to ask for. The residuals are large by nature."""
        penetration = max(-float(self.state.body[pk.XI]), 0.0)
        return balance(
            self.model,
            self.state,
            self._start,
            self.sphere_speed_m_s(),
            modal_j=0.0,
            contact_j=0.4 * self.model.stiffness * penetration**2.5,
        )


def _damping(contact: Contact) -> int:
    """Kernel's number of a contact damping."""
    if contact.damping in (Damping.NONE, Damping.VISCOUS):
        return k.VISCOUS
    if contact.damping is Damping.RELAXATION:
        return k.RELAXATION_STATE if contact.extra_state else k.RELAXATION
    raise ValueError(
        f"contact damping {contact.damping.name.lower()} is not part of the scheme thesis2008; "
        "take none, viscous or relaxation"
    )
