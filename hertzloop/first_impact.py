"""The first impact of a scene: from when to when it lasts, in steps.

The definition itself is in `plant.figures.answer_kernels`; here are the scene's times.
"""

from hertzloop import assembly as parts
from hertzloop.scenes.scene import Scene
from plant.figures.answer_kernels import Answer, answer

_QUIET_S = 1e-4  # silence after which a law that pushes again has begun anew
_LEAST_STEPS = 2  # in which a rebound is seen
_SIGMAS = 8.0  # no noise is larger


def quiet_steps(scene: Scene) -> int:
    """Steps of silence after which a new force may belong to the next contact."""
    quiet = round(_QUIET_S / scene.step_s) + scene.in_steps(scene.controller.jitter_us)
    return max(quiet, _LEAST_STEPS)


def answer_of(scene: Scene) -> Answer:
    """An impact of the scene, before its first touch, for rows that are known."""
    table = scene.controller
    line = 1 + scene.in_steps(table.latency_us) + scene.in_steps(table.jitter_us)
    return answer(quiet_steps(scene), line)


def ending_of(scene: Scene) -> Answer:
    """The same for a loop that ends as soon as nothing to come can belong to the impact."""
    if scene.sensors.quantity != "xi":
        return answer_of(scene)
    blur_m = _SIGMAS * scene.sensors.noise_rms
    limits = parts.full_scale(scene)
    if limits is not None and scene.sensors.bits != "ideal":
        blur_m += (limits[1] - limits[0]) / (2 ** int(scene.sensors.bits) - 1)
    return answer_of(scene)._replace(blur_m=blur_m)


NEVER = answer(-1)  # what a loop takes that does not end before its last step
