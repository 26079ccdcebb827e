"""The one table of schemes, and one `step` for all of them.

A compiled caller is specialised to the scheme by the type of the model, so the choice costs
nothing per step.
"""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

from jit.by_type import by_type, no
from plant.schemes import infinite_kernels as infinite


@dataclass(frozen=True)
class Scheme:
    """Where a scheme is, as "module:Class": its plant, as `plant.plant.Plant`, and the model of
    that in the file of its kernels.

    `tail`: modes left out may be a spring or a damped mode; else it knows none of them.
    """

    plant: str
    model: str
    tail: bool = False

    def load(self) -> Any:
        """The class of the plant."""
        module, name = self.plant.split(":")
        return getattr(import_module(module), name)

    def kernels(self) -> tuple[type, Any]:
        """The class of the model, and the module of its kernels."""
        name, model = self.model.split(":")
        module = import_module(name)
        return getattr(module, model), module


_AT = "plant.schemes"
SCHEMES = {
    "modal": Scheme(
        f"{_AT}.collocation:CollocationPlant", f"{_AT}.collocation_kernels:CollocationModel", True
    ),
    "discrete_gradient": Scheme(
        "plant.plant:Plant", f"{_AT}.discrete_gradient_kernels:PlantModel"
    ),
    "thesis2008": Scheme(
        f"{_AT}.thesis2008:ThesisPlant", f"{_AT}.thesis2008_kernels:ThesisModel"
    ),
}  # fmt: skip
_MODELS = dict(scheme.kernels() for scheme in SCHEMES.values())
_MODELS[infinite.InfiniteModel] = infinite
# Advance one step: model, state, commanded actuator force (N) -> contact force (N).
step = by_type({model: kernels.step for model, kernels in _MODELS.items()})


def _known(name):
    """A property of models, False for schemes whose kernels have no such function."""
    return by_type({model: getattr(kernels, name, no) for model, kernels in _MODELS.items()})


# Whether the actuator's force can change within a step, and whether the contact can yield.
has_slope, yields = _known("has_slope"), _known("yields")
