"""The scheme `thesis2008`: sampled Green's functions, and a plant that is driven like `modal`.

See `thesis2008_kernels` for the numerics. They conserve neither momentum nor energy; the
balance says by how much.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from hertzloop.plant.contact.hertz import Contact, Damping
from hertzloop.plant.plant import Balance, Plant, PlantSpec, balance, quoted
from hertzloop.plant.schemes import thesis2008_kernels
from hertzloop.plant.schemes.thesis2008_kernels import (
    ADVANCE,
    BETA,
    COUNTS_SIZE,
    GAMMA,
    MOTION_SIZE,
    NEXT_IMPACT,
    REL_V,
    RELAXATION,
    RELAXATION_STATE,
    TOUCHING,
    VISCOUS,
)
from hertzloop.plant.state_kernels import (
    BALANCE_SIZE,
    BODY_SIZE,
    FLIGHT_STEP,
    FLIGHT_V,
    FLIGHT_X,
    GRAVITY_M_S2,
    STEP,
    V_P,
    XI,
    XI_S,
)
from hertzloop.plant.structures.modes import Oscillators
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.structure import oscillators

NEWTON_ALLOWED = 30_000_000  # the published runs needed up to 22,942,400
_MOST_STEPS = 500_000
_DAMPINGS = ("none", "viscous", "relaxation")
_BLOCK, _MODES_TOGETHER = 256, 8  # samples and modes whose sums stay in the nearest memory


def green_functions(
    plate: Plate, modes: Oscillators, step_s: float, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement, velocity and acceleration at the contact point after a unit impulse there.

    Sampled at 0, dt, 2 dt ..., shape (count,), in m, m/s, m/s^2 per N s; the acceleration's
    first value is zero, as published. g(t) = lambda sum Phi^2 sin(Theta t)/Theta e^(-delta t).
    """
    eta = plate.eta
    root = math.sqrt(1.0 - eta * eta / 4.0)
    theta = modes.omega * root
    weight = plate.modal_scale_per_kg * modes.contact * modes.contact / theta
    total = np.zeros((3, -(-count // _BLOCK), _BLOCK))
    room = [np.empty((_MODES_TOGETHER, *each)) for each in ((2, _BLOCK), (3, 2), (2,))]
    decay = theta * (-(eta / 2.0) / root)
    thesis2008_kernels.add_modes(decay, theta, weight, step_s, *room, total)
    sampled = total.reshape(3, -1)[:, :count].copy()
    sampled[2, 0] = 0.0
    return sampled[0], sampled[1], sampled[2]


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
        advanced = change / (ADVANCE * step_s) - v
        a1 = (advanced / step_s - (0.5 - BETA) * a) / BETA
        v += ADVANCE * step_s * ((1.0 - GAMMA) * a + GAMMA * a1)
        a = a1
    return v


class ThesisPlant(Plant):
    """Model and state of the published scheme, for a run of at most `steps` steps.

    Raises ValueError when the actuator does not push at the contact point, or when contact
    damping is Hunt-Crossley's: the published scheme has neither.
    """

    kernels: Any = thesis2008_kernels

    @classmethod
    def refusal(cls, what: str, value: object = None) -> str:
        """See `Plant`."""
        if what in ("plate.edges", "plate.modes"):
            return "supports a simply supported plate only"
        if what == "plate.actuator_point_m":
            return "supports a force at the contact point only"
        if what == "run.touch_phase":
            return "lets every contact begin at a sample"
        if what == "contact.damping":
            return "" if value in _DAMPINGS else f"supports {quoted(_DAMPINGS)} only"
        if what == "steps":
            assert isinstance(value, int)
            return (
                "" if value <= _MOST_STEPS else f"keeps the history of at most {_MOST_STEPS} steps"
            )
        return super().refusal(what, value)

    def __init__(self, spec: PlantSpec, steps: int, most_iterations: int = NEWTON_ALLOWED) -> None:
        if not spec.same_point:
            raise ValueError(
                f"actuator_point_m = {list(spec.actuator_point_m)} is not the contact point; the "
                "scheme thesis2008 knows a force at the contact point only"
            )
        self.spec = spec
        self._steps, self._most_iterations = steps, most_iterations
        self.modes, self._green = sampled(
            spec.simply_supported, spec.contact_point_m, spec.step_s, steps + 2
        )
        self.model = self._build_model()
        self.state = self._initial_state()

    def _build_model(self) -> thesis2008_kernels.ThesisModel:
        spec, contact = self.spec, self.spec.contact
        green_x, green_v, green_a = self._green
        return thesis2008_kernels.ThesisModel(
            step_s=spec.step_s,
            mass_kg=spec.sphere.mass_kg,
            gravity_m_s2=GRAVITY_M_S2,
            stiffness=contact.stiffness,
            damping=_damping(contact),
            viscous_n_s_m=contact.viscous_n_s_m,
            relaxation_stiffness=contact.relaxation_stiffness,
            relaxation_s=contact.relaxation_s,
            most_iterations=self._most_iterations,
            same_point=True,
            green_x=green_x,
            green_v=green_v,
            green_a=green_a,
        )

    def _empty_state(self) -> thesis2008_kernels.ThesisState:
        steps = self._steps
        memory = steps + 2 if self.model.damping != VISCOUS else 0
        decay = np.empty(memory)
        if memory:
            thesis2008_kernels.fill_decay(self.model.step_s, self.model.relaxation_s, decay)
        return thesis2008_kernels.ThesisState(
            body=np.zeros(BODY_SIZE),
            balance=np.zeros(BALANCE_SIZE),
            counts=np.zeros(COUNTS_SIZE, np.int64),
            motion=np.zeros(MOTION_SIZE),
            total=np.zeros(steps + 2),
            undamped=np.zeros(steps + 2),
            depth=np.zeros(steps + 2),
            decay=decay,
        )

    def _initial_state(self) -> thesis2008_kernels.ThesisState:
        state = self._empty_state()
        speed, h = self.spec.sphere.impact_speed_m_s, self.model.step_s
        lead = round(min(self.spec.lead_in_s, speed / GRAVITY_M_S2) / h)
        state.counts[NEXT_IMPACT] = lead
        state.body[FLIGHT_V] = -speed
        if lead:
            state.body[FLIGHT_X] = lead * h * (speed - 0.5 * GRAVITY_M_S2 * lead * h)
            state.body[FLIGHT_V] = GRAVITY_M_S2 * lead * h - speed
            state.body[XI] = state.body[XI_S] = state.body[FLIGHT_X]
        else:
            thesis2008_kernels.begin_impact(self.model, state, 0, speed)
        self._start = state.body[[FLIGHT_X, FLIGHT_V]].copy()
        return state

    def contact_energy_j(self) -> float:
        """Energy stored in the contact at the present step, J."""
        penetration = max(-float(self.state.body[XI]), 0.0)
        return float(0.4 * self.model.stiffness * penetration**2.5)

    def sphere_speed_m_s(self) -> float:
        """Speed of the sphere at the present step, up positive."""
        body, counts = self.state.body, self.state.counts
        if counts[TOUCHING]:
            return float(self.state.motion[REL_V] + body[V_P])
        flight_s = (counts[STEP] - counts[FLIGHT_STEP]) * self.model.step_s
        return float(body[FLIGHT_V] - GRAVITY_M_S2 * flight_s)

    def close_balance(self) -> Balance:
        """Balance of the run. `modal_dissipated_j` is all work on the plate: the published
        numerics have no energy of the plate to ask for. The residuals are large by nature."""
        return balance(
            self.model,
            self.state,
            self._start,
            self.sphere_speed_m_s(),
            modal_j=0.0,
            contact_j=self.contact_energy_j(),
        )


def _damping(contact: Contact) -> int:
    """Kernel's number of a contact damping."""
    if contact.damping in (Damping.NONE, Damping.VISCOUS):
        return VISCOUS
    if contact.damping is Damping.RELAXATION:
        return RELAXATION_STATE if contact.extra_state else RELAXATION
    raise ValueError(
        f"contact damping {contact.damping.name.lower()} is not part of the scheme thesis2008; "
        "take none, viscous or relaxation"
    )
