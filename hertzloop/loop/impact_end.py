"""When a simulated loop may end, if only its first impact counts."""

from hertzloop.plant.metrics.impact_kernels import ImpactFollower, new_follower
from hertzloop.scene.setup import Setup

_QUIET_S = 1e-4  # without force; a law that acts again later acts on another contact
_LEAST_STEPS = 2  # in which a rebound is seen
_SIGMAS = 8.0  # no noise is larger


def quiet_steps(setup: Setup) -> int:
    """Return how many steps without force separate a contact from the next."""
    quiet = round(_QUIET_S / setup.step_s) + setup.line.most_added_steps
    return max(quiet, _LEAST_STEPS)


def impact_follower(setup: Setup) -> ImpactFollower:
    """Return the state of a first impact before the contact, for time series that are known."""
    quiet = quiet_steps(setup)
    line_steps = 1 + setup.line.latency_steps + setup.line.most_added_steps
    return new_follower(quiet, line_steps)


def impact_follower_of_loop(setup: Setup) -> ImpactFollower:
    """Return the same for a loop that ends as soon as no later step can belong to the impact.

    Noise and the steps of the converter make the gap that the law sees uncertain.
    """
    if setup.quantity != "xi":
        return impact_follower(setup)
    blur_m = _SIGMAS * setup.sensor.noise_rms + setup.converter_step
    return impact_follower(setup)._replace(blur_m=blur_m)
