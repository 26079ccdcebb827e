"""How long the forces of a scene may be silent within an impact."""

from hertzloop.plant.metrics.impact_kernels import ImpactFollower, new_follower
from hertzloop.scene.setup import Setup

_QUIET_S = 1e-4  # without force; a law that acts again later acts on another contact
_LEAST_STEPS = 2  # in which a rebound is seen


def quiet_steps(setup: Setup) -> int:
    """Return how many steps without force separate a contact from the next."""
    quiet = round(_QUIET_S / setup.run.step_s) + setup.signal_path.most_added_steps
    return max(quiet, _LEAST_STEPS)


def impact_follower(setup: Setup) -> ImpactFollower:
    """Return the state of a first impact before the contact."""
    quiet = quiet_steps(setup)
    path_steps = 1 + setup.signal_path.latency_steps + setup.signal_path.most_added_steps
    return new_follower(quiet, path_steps)
