"""The one table of schemes: where each is, what it supports, and one `step` for all.

A scheme of your own is a row more: here, for all processes of a clone, or added to `SCHEMES` by a
program, for the runs in its own process. A compiled caller is specialised to the scheme by the type
of the model, so the choice costs nothing per step.
"""

import sys
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from numba import config
from numba.extending import overload

from hertzloop.common.jit import kernel
from hertzloop.common.uncompiled import plain


@dataclass(frozen=True)
class Scheme:
    """Where a scheme is, as "module:Class", and what it supports.

    `plant`: its plant, a `plant.plant.Plant`, whose model is of a class of its own in the file of
    its kernels.
    """

    plant: str

    # What its samples are.
    records_slope: bool = False  # the contact force changes within a step: truth has its slope
    converges: bool = True  # to the exact motion as steps become shorter
    conserves: bool = True  # energy and momentum, which the metrics of impacts rest on
    has_linear_model: bool = False  # of its modes under forces that are held: the margin's
    note: str = ""  # what a reader of results has to know of it

    # How its plant is made.
    limits_modes: bool = True  # as many modes as the accuracy needs; else all up to 1/(2 step)
    keeps_history: bool = False  # its plant has to be told the number of steps
    most_steps: int | None = None  # of a run

    # What a scene may ask for.
    dampings: frozenset[str] = frozenset({"none", "viscous", "hunt_crossley"})  # of the contact
    supports_edges: bool = True  # structures other than a simply supported plate
    supports_separate_actuator: bool = True  # a force beside the contact point
    supports_touch_phase: bool = True  # a touch between two samples
    supports_truncated_modes: bool = False  # the modes left out as a spring, or as one damped mode
    supports_yield: bool = False  # a contact that yields
    supports_actuator_dynamics: bool = False  # bandwidth, mass and limit of the actuator
    supports_sensor_elsewhere: bool = False  # a sensor beside the contact
    supports_export: bool = False  # its plant as an FMU or a C library
    supports_infinite_plate: bool = False  # a plate without modes

    def load(self) -> Any:
        """The class of the plant."""
        module, name = self.plant.split(":")
        return getattr(import_module(module), name)


_AT = "hertzloop.plant.schemes"
SCHEMES = {
    "modal": Scheme(
        f"{_AT}.modal:ModalPlant", supports_infinite_plate=True,
        records_slope=True, has_linear_model=True,
        supports_truncated_modes=True, supports_yield=True,
        supports_actuator_dynamics=True,
        supports_sensor_elsewhere=True, supports_export=True,
    ),
    "thesis2008": Scheme(
        f"{_AT}.thesis2008:ThesisPlant",
        converges=False, conserves=False, note="published numerics, flaws included",
        limits_modes=False, keeps_history=True, most_steps=500_000,
        dampings=frozenset({"none", "viscous", "relaxation"}), supports_edges=False,
        supports_separate_actuator=False, supports_touch_phase=False,
    ),
}  # fmt: skip


def supporting(capability: str) -> str:
    """Names of the schemes that have a field of `Scheme`, quoted."""
    names = [f"'{name}'" for name, row in SCHEMES.items() if getattr(row, capability)]
    return " or ".join(names)


def _kernels(model: type) -> Any:
    """The module of a scheme's kernels, where the class of its model is."""
    return sys.modules[model.__module__]


# What a compiled caller calls of whatever scheme its model is; settled when it is compiled.


def step(model: Any, state: Any, command: float) -> float:
    """Advance one step under a commanded actuator force (N); returns the contact force (N)."""
    called = _kernels(type(model)).step if config.DISABLE_JIT else _entry
    return float(called(model, state, command))


def close_balance(model: Any, state: Any) -> float:
    """Book what is not booked in every step; returns the energy of the structure, J."""
    return float(_kernels(type(model)).close_balance(model, state))


def contact_energy(model: Any, state: Any) -> float:
    """Energy stored in the contact, J."""
    return float(plain(_kernels(type(model)).contact_energy)(model, state))


@overload(step, inline="always")
def _step(model, state, command):
    of_scheme = _kernels(model.instance_class).step
    return lambda model, state, command: of_scheme(model, state, command)


@overload(close_balance, inline="always")
def _close_balance(model, state):
    of_scheme = _kernels(model.instance_class).close_balance
    return lambda model, state: of_scheme(model, state)


@overload(contact_energy, inline="always")
def _contact_energy(model, state):
    of_scheme = _kernels(model.instance_class).contact_energy
    return lambda model, state: of_scheme(model, state)


@kernel
def _entry(model, state, command):
    """A step for Python."""
    return step(model, state, command)
