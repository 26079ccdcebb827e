"""The first impact of a scene: from when to when it lasts, in steps.

The definition itself is in `plant.figures.answer_kernels`; here are the scene's times.
"""

from hertzloop.setup import Setup
from plant.figures.answer_kernels import Answer, answer

_QUIET_S = 1e-4  # silence after which a law that pushes again has begun anew
_LEAST_STEPS = 2  # in which a rebound is seen
_SIGMAS = 8.0  # no noise is larger


def quiet_steps(setup: Setup) -> int:
    """Steps of silence after which a new force may belong to the next contact."""
    quiet = round(_QUIET_S / setup.step_s) + setup.line.jitter_steps
    return max(quiet, _LEAST_STEPS)


def answer_of(setup: Setup) -> Answer:
    """An impact of the scene, before its first touch, for rows that are known."""
    return answer(quiet_steps(setup), 1 + setup.line.latency_steps + setup.line.jitter_steps)


def ending_of(setup: Setup) -> Answer:
    """The same for a loop that ends as soon as nothing to come can belong to the impact."""
    if setup.quantity != "xi":
        return answer_of(setup)
    blur_m = _SIGMAS * setup.sensor.noise_rms + setup.converter_step
    return answer_of(setup)._replace(blur_m=blur_m)


NEVER = answer(-1)  # what a loop takes that does not end before its last step
