"""One `step` for every scheme, and what else of a model is settled when a loop is compiled.

A compiled caller is specialised to the scheme by the type of the model, so the choice costs
nothing per step.
"""

from jit.by_type import by_type, no
from plant.schemes import collocation_kernels as collocation
from plant.schemes import discrete_gradient_kernels as discrete_gradient
from plant.schemes import infinite_kernels as infinite
from plant.schemes import thesis2008_kernels as thesis2008

_MODELS = {
    collocation.CollocationModel: collocation,
    discrete_gradient.PlantModel: discrete_gradient,
    infinite.InfiniteModel: infinite,
    thesis2008.ThesisModel: thesis2008,
}
# Advance one step: model, state, commanded actuator force (N) -> contact force (N).
step = by_type({model: kernels.step for model, kernels in _MODELS.items()})


def _known(name):
    """A property of models, False for schemes whose kernels have no such function."""
    return by_type({model: getattr(kernels, name, no) for model, kernels in _MODELS.items()})


# Whether the actuator's force can change within a step, and whether the contact can yield.
has_slope, yields = _known("has_slope"), _known("yields")
