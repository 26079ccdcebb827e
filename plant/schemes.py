"""One `step` for every scheme: which kernel runs follows from the type of the model.

A compiled caller is specialised to the scheme when it is compiled, so the choice costs
nothing per step.
"""

from typing import Any

from numba import types
from numba.extending import overload

from plant import collocation_kernels as collocation
from plant import infinite_kernels as infinite
from plant import kernels as discrete_gradient
from plant import thesis2008_kernels as thesis2008

_STEPS = {
    collocation.CollocationModel: collocation.step,
    discrete_gradient.PlantModel: discrete_gradient.step,
    infinite.InfiniteModel: infinite.step,
    thesis2008.ThesisModel: thesis2008.step,
}


def step(model: Any, state: Any, f_a: float) -> float:
    """Advance one step under actuator force `f_a` (N); returns the contact force (N)."""
    return float(_STEPS[type(model)](model, state, f_a))


@overload(step, jit_options={"_nrt": False})
def _compiled_step(model: Any, state: Any, f_a: Any) -> Any:
    kernel = _STEPS.get(model.instance_class) if isinstance(model, types.NamedTuple) else None
    if kernel is None:
        return None

    # Numba wants the same names and annotations as those of the decorated function.
    def implementation(model: Any, state: Any, f_a: Any) -> Any:
        return kernel(model, state, f_a)

    return implementation
