"""Plant and sensor at the start of a run."""

import math

import numpy as np

from hertzloop.closed_loop.parts import series_under
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.plant.estimates.model_order import least_limit_hz
from hertzloop.plant.plant import Plant, PlantSpec
from hertzloop.plant.schemes.factory import plant_at_start
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.sensors.acquisition import Sensor


def build_plant(
    setup: Setup, spec: PlantSpec | None = None, steps: int | None = None, *, flight: bool = False
) -> Plant:
    """The plant at the start of the run, or that of another description `spec` by the same scheme,
    for as many `steps` as are to be run, by default all; `flight`: no impact is asked of it. Raises
    SceneError for what the scheme does not know, and modes too low for impacts.
    """
    spec = spec or setup.plant
    if not flight:
        check_modes_reach_impact(spec)
    try:
        return plant_at_start(spec, setup.run.scheme, steps or setup.run.steps, setup.run.phase)
    except ValueError as error:
        raise SceneError(str(error)) from error


def check_modes_reach_impact(spec: PlantSpec) -> None:
    """Refuse modes of a file that leave out all of an impact, unless an infinite plate stands for
    the rest or a model of them was asked for. In flight they are right all the same. Raises
    SceneError."""
    sphere, plate, contact = spec.sphere, spec.plate, spec.contact
    if plate.mode_table is None or spec.infinite_plate:
        return
    needed_hz = least_limit_hz(sphere, plate, contact, spec.frequency_limit_hz)
    if spec.frequency_limit_hz > needed_hz or spec.damped_residual or spec.truncation_asked:
        return
    if needed_hz == math.inf:
        raise SceneError(
            f"contact.damping: is too large for {plate}, which leave out too much flexibility. "
            "Give modes up to a higher frequency, or less damping."
        )
    lasts_s = rigid_impact(sphere, contact).contact_s
    grain = 10.0 ** (math.floor(math.log10(needed_hz)) - 2)  # rounded up, to three digits
    raise SceneError(
        f"{plate} reach up to {spec.frequency_limit_hz:,.6g} Hz, too low for an impact of "
        f"{1e6 * lasts_s:.3g} us; give modes up to {(needed_hz // grain + 1) * grain:,.6g} Hz at "
        "least (are they in Hz?), plate.thickness_m if it is a plate at the contact point, or "
        "plate.tail = 'spring' to run with an error that is not known"
    )


def build_sensor(setup: Setup, steps: int | None = None) -> Sensor:
    """The data-acquisition channel at the start of the run, for as many `steps` as are to be run,
    by default all."""
    return Sensor(setup.sensor, setup.run.step_s, steps or setup.run.steps, setup.run.seed)


def free_series(setup: Setup) -> np.ndarray:
    """Simulate the plant alone, without any force of the actuator; its time series, shape
    (10, steps)."""
    return series_under(build_plant(setup), np.zeros(1), setup.run.steps)
