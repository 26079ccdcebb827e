"""The description of a plant, its modes, and what every scheme makes of them."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np

from hertzloop.common.protocols import Structure
from hertzloop.common.uncompiled import plain
from hertzloop.plant import state_kernels
from hertzloop.plant.actuator import IDEAL, Actuator, mass_loaded
from hertzloop.plant.contact.hertz import Contact, Sphere
from hertzloop.plant.contact.yielding import dent_now_m
from hertzloop.plant.numerics import RIGID_RAD_S
from hertzloop.plant.state_kernels import (
    BALANCE_SIZE,
    CONTACT_STEPS,
    DEEPEST,
    FALLBACKS,
    FLIGHT_V,
    FLIGHT_X,
    GRAVITY_M_S2,
    NEWTON_MAX,
    NEWTON_TOTAL,
    STEP,
    XI,
    XI_S,
)
from hertzloop.plant.structures.modes import Oscillators
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.structure import ComparedByParts, oscillators


@dataclass(frozen=True)
class Balance:
    """Energy (J) and momentum (N s) of a run; residuals are relative, see `balance`.

    `modal_dissipated_j` went to the structure, and to the modes left out where these are damped;
    `newton_fallbacks`: contact steps in which Newton's method did not end.
    """

    energy_start_j: float
    kinetic_j: float
    gravity_j: float
    modal_j: float
    contact_j: float
    modal_dissipated_j: float
    contact_dissipated_j: float
    injected_j: float
    plastic_dissipated_j: float
    dent_m: float
    energy_residual: float
    momentum_change_n_s: float
    contact_impulse_n_s: float
    gravity_impulse_n_s: float
    momentum_residual: float
    newton_iterations: int
    newton_iterations_max: int
    newton_fallbacks: int
    contact_steps: int


def balance(
    model: Any,
    state: Any,
    start: np.ndarray,
    speed_m_s: float,
    *,
    modal_j: float,
    contact_j: float,
    dent_m: float = 0.0,
) -> Balance:
    """Balance of a run that began with the sphere at `start` (m, m/s) and ends at `speed_m_s`.

    The energy residual is relative to the energy at the start plus the size of what the
    actuator exchanged, the momentum residual to the impulses exchanged.
    """
    m, g, (x0, v0) = model.mass_kg, model.gravity_m_s2, start.tolist()
    energy = m * g * x0 + 0.5 * m * v0 * v0
    kinetic = 0.5 * m * speed_m_s * speed_m_s
    gravity = m * g * float(state.body[XI_S])
    lost_modal, lost_contact, injected, impulse, yielded = state.balance[:BALANCE_SIZE].tolist()
    gap = kinetic + gravity + modal_j + contact_j + lost_modal + lost_contact + yielded
    gap = gap - injected - energy
    change = m * (speed_m_s - v0)
    weight = -m * g * float(state.counts[STEP]) * model.step_s
    return Balance(
        energy_start_j=energy,
        kinetic_j=kinetic,
        gravity_j=gravity,
        modal_j=modal_j,
        contact_j=contact_j,
        modal_dissipated_j=lost_modal,
        contact_dissipated_j=lost_contact,
        injected_j=injected,
        plastic_dissipated_j=yielded,
        dent_m=dent_m,
        energy_residual=gap / (energy + abs(injected)),
        momentum_change_n_s=change,
        contact_impulse_n_s=impulse,
        gravity_impulse_n_s=weight,
        momentum_residual=(change - impulse - weight) / (abs(impulse) + abs(weight) + m * abs(v0)),
        newton_iterations=int(state.counts[NEWTON_TOTAL]),
        newton_iterations_max=int(state.counts[NEWTON_MAX]),
        newton_fallbacks=int(state.counts[FALLBACKS]),
        contact_steps=int(state.counts[CONTACT_STEPS]),
    )


@dataclass(frozen=True, eq=False)
class PlantSpec(ComparedByParts):
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
    damped_residual: bool = False  # that as a damped mode instead; needs residual_flexibility
    infinite_plate: bool = False  # no modes: a dashpot, until reflections return
    actuator: Actuator = IDEAL
    sensor_point_m: tuple[float, float] | None = None  # None: at the contact
    truncation_asked: bool = False  # for what stands for the modes left out, however few there are

    @cached_property
    def same_point(self) -> bool:
        """Whether the actuator acts at the contact point."""
        return self.plate.same_point(self.contact_point_m, self.actuator_point_m)

    @property
    def mass_at_contact(self) -> bool:
        """Whether the actuator's mass is on the contact point."""
        return self.actuator.mass_kg > 0.0 and self.same_point

    @property
    def simply_supported(self) -> Plate:
        """The plate, for what is known of a simply supported one only. Raises ValueError."""
        if self.plate.simply_supported is None:
            raise ValueError(f"not defined for {self.plate}; it takes a simply supported plate")
        return self.plate.simply_supported

    @property
    def local_plate(self) -> Plate:
        """What the contact feels until reflections return. Raises ValueError if there is none."""
        if self.plate.local_plate is None:
            raise ValueError(NO_IMPEDANCE)
        return self.plate.local_plate


NO_IMPEDANCE = (
    "the impedance of an infinite plate is not known for plate.modes alone; give "
    "plate.thickness_m, if the structure is a plate at the contact point"
)
MOST_MODES = 500_000
# What stands for the modes where there are none, or too many to compute.
NO_MODES = Oscillators(np.zeros(0), np.zeros(0), np.zeros(0), 0, 0.0, 1.0)


@lru_cache(maxsize=8)
def modes_of(spec: PlantSpec) -> Oscillators:
    """Oscillators of a description: of its structure with the actuator's mass on it. Kept: the
    plant has them, and the metrics of its runs. `NO_MODES` for an infinite plate with too many.

    Raises ValueError for a mass on modes with loss factors of their own, or on a rigid body's.
    """
    if spec.infinite_plate and spec.plate.modes_below(spec.frequency_limit_hz) > MOST_MODES:
        return NO_MODES
    omega_max = 2.0 * math.pi * spec.frequency_limit_hz
    at_actuator, mass_kg = spec.actuator_point_m, spec.actuator.mass_kg
    modes = oscillators(
        spec.plate, spec.contact_point_m, at_actuator, omega_max, spec.sensor_point_m
    )
    if mass_kg == 0.0:
        return modes
    if isinstance(modes.eta, np.ndarray):
        raise ValueError(
            f"actuator.mass_kg = {mass_kg:g} needs one loss factor for all modes. "
            "Remove the key, or give plate.modes with one loss factor."
        )
    if modes.omega[0] <= RIGID_RAD_S:
        remedy = "support one of plate.edges"
        if spec.plate.mode_table is not None:
            remedy = "give plate.modes of the structure that carries this mass"
        raise ValueError(
            f"actuator.mass_kg = {mass_kg:g} is not supported for a free plate. Remove the key, "
            f"or {remedy}."
        )
    spring = _spring_m_n(spec, omega_max, at_actuator)
    return mass_loaded(modes, mass_kg, spring, spec.same_point)


def _spring_m_n(spec: PlantSpec, omega_max: float, point_m: tuple[float, float]) -> float:
    """Flexibility between the modes and a mass on the plate, m/N."""
    if not spec.residual_flexibility:
        return 0.0
    return spec.plate.struck_at_actuator.residual_flexibility_m_n(omega_max, point_m)


# What any scheme has: keys of a scene, and values of contact.damping.
_OF_ALL_SCHEMES = (
    "plate.edges",
    "plate.modes",
    "plate.actuator_point_m",
    "run.touch_phase",
    "steps",
)
_DAMPINGS = ("none", "viscous", "hunt_crossley")


def quoted(names: Iterable[str]) -> str:
    """Names in quotes, for a message."""
    return ", ".join(f"'{name}'" for name in names)


class Plant(ABC):
    """A description as a run needs it: modes, model, state, and a balance at the end.

    A scheme says how a step is made: `kernels` is a module with `step(model, state, command)`,
    which returns the mean contact force of the step (N), `contact_energy(model, state)`, J, and
    `close_balance(model, state)`, which returns the energy of the modes. The class of its model is
    defined in that module too: a model's kernels are found by its class. Its state has the arrays
    `body`, `balance` and `counts` of `hertzloop.plant.state_kernels`, and more as it likes.
    """

    kernels: Any
    touch_phase = 0.5  # of a step, from the last sample above the plate to the first touch

    @classmethod
    def refusal(cls, what: str, value: object = None) -> str:
        """Why the scheme cannot have a scene's key at a value, or serve a command: what follows
        "which" in a sentence; "" if it can.

        A scheme has, unless it says otherwise, what any set of modes gives it: every structure, an
        actuator elsewhere and a touch between samples, and a damper in the contact. `what` is
        also "steps", of a run, and the names of commands.
        """
        if what == "contact.damping":
            return "" if value in _DAMPINGS else f"supports {quoted(_DAMPINGS)} only"
        return "" if what in _OF_ALL_SCHEMES else "does not have it"

    def __init__(self, spec: PlantSpec) -> None:
        self.spec = spec
        self.modes = self._structure_modes()
        self.model: Any = self._build_model()
        self.state = self._initial_state()

    def _structure_modes(self) -> Oscillators:
        return modes_of(self.spec)

    @abstractmethod
    def _build_model(self) -> Any:
        """What does not change during a run, a NamedTuple of its own type."""

    @abstractmethod
    def _empty_state(self) -> Any:
        """The state at the start of a run, but for the sphere."""

    def at_start(self, touch_phase: float = 0.5) -> Self:
        """The same plant at the start of a run: model shared, state new."""
        new = copy(self)
        new.touch_phase = touch_phase
        new.state = new._initial_state()
        return new

    def _initial_state(self) -> Any:
        state = self._empty_state()
        spec = self.spec
        state.body[FLIGHT_X], state.body[FLIGHT_V] = state_kernels.released(
            float(spec.sphere.impact_speed_m_s),
            GRAVITY_M_S2,
            float(spec.lead_in_s),
            spec.step_s,
            float(self.touch_phase),
        )
        state.body[XI] = state.body[XI_S] = state.body[FLIGHT_X]
        self._start = state.body[[FLIGHT_X, FLIGHT_V]].copy()
        return state

    def sphere_speed_m_s(self) -> float:
        """Speed of the sphere at the present step, up positive."""
        body, counts = self.state.body, self.state.counts
        return float(
            state_kernels.speed_now(self.model.gravity_m_s2, self.model.step_s, body, counts)
        )

    def close_balance(self) -> Balance:
        """Energy and momentum of the run so far; to be called once, at its end. See `balance`."""
        speed_m_s, contact_j = self.sphere_speed_m_s(), self.contact_energy_j()
        modal_j = float(self.kernels.close_balance(self.model, self.state))
        return balance(
            self.model,
            self.state,
            self._start,
            speed_m_s,
            modal_j=modal_j,
            contact_j=contact_j,
            dent_m=dent_now_m(self.spec.contact, float(self.state.body[DEEPEST])),
        )

    def contact_energy_j(self) -> float:
        """Energy stored in the contact at the present step, J."""
        stored = self.kernels.contact_energy
        return float(plain(stored)(self.model, self.state))
