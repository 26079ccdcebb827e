"""What a setup's model of the plate is expected to cost."""

from hertzloop.plant.estimates.model_order import expected_error as error_of_modes
from hertzloop.plant.estimates.model_order import law_error
from hertzloop.scene.setup import Setup


def expected_error(setup: Setup) -> float:
    """Return the relative error of penetration or plate energy that leaving out modes, or the
    reflections, is expected to cost; under a law at least what the steps of its force do."""
    spec = setup.plant
    if spec.infinite_plate:
        return setup.infinite_plate.error(setup.run.duration_s - setup.first_touch_s)
    found = error_of_modes(
        spec.sphere,
        spec.plate,
        spec.contact,
        spec.frequency_limit_hz,
        spring=spec.residual_flexibility,
        damped=spec.damped_residual,
    )
    if not spec.residual_flexibility or spec.frequency_limit_hz == 0.0:  # modes of a rigid body
        return found
    bound = setup.infinite_plate.force_bound
    hold_s = setup.run.step_s * setup.sensor.every_steps
    return max(found, law_error(spec, bound.force_n, bound.share, hold_s))
