"""The one table of schemes: where each is, and one `step` for all.

A scheme of your own is a row more: here, for all processes of a clone, or added to `SCHEMES` by a
program, for the runs in its own process. A compiled caller is specialised to the scheme by the type
of the model, so the choice costs nothing per step.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

from numba import config
from numba.extending import overload

from hertzloop.common.jit import kernel
from hertzloop.common.uncompiled import plain


@cache  # asked ten times a case of a sweep
def _loaded(plant: str) -> Any:
    module, name = plant.split(":")
    return getattr(import_module(module), name)


@dataclass(frozen=True)
class Scheme:
    """Where a scheme is, as "module:Class", and what its samples are.

    `plant`: its plant, a `plant.plant.Plant`, whose model is of a class of its own in the file of
    its kernels, and which refuses what the scheme cannot do (`Plant.refusal`).
    """

    plant: str
    records_slope: bool = False  # the contact force changes within a step: truth has its slope
    converges: bool = True  # to the exact motion as steps become shorter
    conserves: bool = True  # energy and momentum, which the metrics of impacts rest on
    note: str = ""  # what a reader of results has to know of it
    limits_modes: bool = True  # as many modes as the accuracy needs; else all up to 1/(2 step)
    keeps_history: bool = False  # its plant has to be told the number of steps

    def load(self) -> Any:
        """The class of the plant."""
        return _loaded(self.plant)

    def refusal(self, what: str, value: object = None) -> str:
        """See `Plant.refusal`."""
        return str(self.load().refusal(what, value))

    def accepts(self, what: str, value: object = None) -> bool:
        """Whether the scheme can have a scene's key at a value, or serve a command."""
        return not self.refusal(what, value)


_AT = "hertzloop.plant.schemes"
SCHEMES = {
    "modal": Scheme(f"{_AT}.modal:ModalPlant", records_slope=True),
    "thesis2008": Scheme(
        f"{_AT}.thesis2008:ThesisPlant",
        converges=False, conserves=False, note="published numerics, flaws included",
        limits_modes=False, keeps_history=True,
    ),
}  # fmt: skip


def schemes_where(fits: Callable[[Scheme], bool]) -> str:
    """Names of the schemes of which something holds, quoted."""
    return " or ".join(f"'{name}'" for name, row in SCHEMES.items() if fits(row))


def _kernels(model: type) -> Any:
    """The module of a scheme's kernels, where the class of its model is."""
    return sys.modules[model.__module__]


# As `kernel(part=True)`: a step is compiled into its caller.
_PART = {
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "forceinline": True,
    "_nrt": False,
}

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


@overload(step, jit_options=_PART, strict=False)
def _step(model, state, command):
    return plain(_kernels(model.instance_class).step)


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
