"""The one table of structures: how each is made of what a scene says, and what fits it.

A structure of your own is a row more: here, for all processes of a clone, or added to `STRUCTURES`
by a program, for the runs in its own process.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module

from hertzloop.common.protocols import Structure
from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.plate import Plate


@dataclass(frozen=True)
class Description:
    """What a scene says of a structure, in SI units; None is not said.

    `edges`: c, f or s (clamped, free, simply supported) at x = 0, x = l_x, y = 0, y = l_y.
    `modes`: name and content of a file of modes; `residual_flexibility_m_n`: static flexibility of
    those not in it, m/N.
    """

    material: Material
    size_m: tuple[float, float] | None = None
    thickness_m: float | None = None
    loss_factor: float | None = None
    edges: str = "ssss"
    modes: tuple[str, bytes] | None = None
    residual_flexibility_m_n: float | None = None

    @property
    def thin_plate(self) -> Plate:
        """A simply supported thin plate of these sizes. Raises ValueError without sizes."""
        if self.size_m is None or self.thickness_m is None:
            raise ValueError("a plate needs plate.size_m and plate.thickness_m; give both")
        return Plate(self.material, self.size_m, self.thickness_m, self.loss_factor)


@dataclass(frozen=True)
class Kind:
    """How a structure is made, and what it needs.

    `make`: a function of a `Description`, as "module:function"; it raises ValueError for what does
    not make such a structure. `theory`: whether it is a plate by its sizes, which a scene takes by
    this name as its `plate.theory`.
    """

    make: str
    theory: bool = True


STRUCTURES = {
    "kirchhoff": Kind("hertzloop.plant.structures.edged_plate:made"),
    "modes": Kind("hertzloop.plant.structures.modal_structure:made", theory=False),
}
THEORIES = tuple(name for name, kind in STRUCTURES.items() if kind.theory)


def maker(kind: str) -> Callable[[Description], Structure]:
    """The function that makes a structure of a kind, as its module has it now."""
    module, name = STRUCTURES[kind].make.split(":")
    make: Callable[[Description], Structure] = getattr(import_module(module), name)
    return make


def structure(kind: str, description: Description) -> Structure:
    """The structure of a kind, one for all runs of the same description and function. Raises
    ValueError."""
    return _made(maker(kind), description)


@lru_cache(maxsize=64)
def _made(make: Callable[[Description], Structure], description: Description) -> Structure:
    return make(description)
