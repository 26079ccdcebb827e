"""What a setup's model of the plate is expected to cost."""

import math

from hertzloop.plant.estimates.model_order import (
    UNDER_LAW,
    expected_solid_error,
    law_error,
    share_at_once,
    velocity_share,
)
from hertzloop.plant.estimates.model_order import expected_error as error_of_modes
from hertzloop.scene.plate_model import widest_limit_hz
from hertzloop.scene.setup import Setup


def expected_error(setup: Setup, until_hz: float = math.inf) -> float:
    """Return the relative error of penetration or plate energy that leaving out modes, or the
    reflections, is expected to cost; under a law at least what the steps of its force do.
    `until_hz`: of these steps count in a solid only what they do below this frequency."""
    spec = setup.plant
    if spec.infinite_plate:
        return setup.infinite_plate.error(setup.duration_s - setup.first_touch_s)
    bodies = (spec.sphere, spec.plate, spec.contact)
    if spec.plate.solid:
        found = expected_solid_error(*bodies, spec.frequency_limit_hz)
        found *= UNDER_LAW if setup.has_law else 1.0
        until_hz = min(until_hz, widest_limit_hz(spec.plate, spec.sphere, spec.contact))
    else:
        found = error_of_modes(
            *bodies,
            spec.frequency_limit_hz,
            spring=spec.residual_flexibility,
            damped=spec.damped_residual,
        )
    if not spec.residual_flexibility or spec.frequency_limit_hz == 0.0:  # modes of a rigid body
        return found
    hold_s = setup.step_s * setup.every_steps
    share = setup.reach.share
    if spec.plate.solid:
        share = _solid_share(setup, until_hz)
        if share >= 1.0 and setup.quantity in _PLATE_MOTION and setup.reach.share < math.inf:
            return 1.0  # the modes left out may make the loop unstable
    return max(found, law_error(spec, setup.reach.force_n, share, hold_s, until_hz))


_PLATE_MOTION = ("v_p", "acceleration")  # quantities of a law that feeds back the plate's motion


def _solid_share(setup: Setup, until_hz: float) -> float:
    """The share of the contact force whose steps drive waves in a solid as the law does."""
    reach, spec = setup.reach, setup.plant
    share = min(reach.share, 1.0)
    if reach.copies or reach.share == math.inf:
        return share
    if setup.quantity not in _PLATE_MOTION:
        return share_at_once(share)
    corners_hz = (spec.actuator.bandwidth_hz, setup.sensor.low_pass_hz)
    return velocity_share(
        spec.plate,
        reach.share,
        spec.frequency_limit_hz,
        min(until_hz, 0.5 / (setup.step_s * setup.every_steps)),
        tuple(hz for hz in corners_hz if hz),
    )
