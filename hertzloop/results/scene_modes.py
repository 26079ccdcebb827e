"""The modes of a scene's structure, as a table that another scene can read."""

import numpy as np

from hertzloop.plant.schemes.modal import residual_m_n
from hertzloop.plant.structures.mode_file import ModeTable
from hertzloop.plant.structures.structure import oscillators
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup


def modes_of_scene(setup: Setup) -> ModeTable:
    """Return the modes that a scene's plant computes with, up to its frequency limit.

    Modes of equal frequency are merged, and modes that no force moves are left out. A run with
    this table gives the bytes of the scene. A mass of the actuator is not part of the modes.

    Raises:
        SceneError: the structure has no modes.
    """
    spec = setup.plant
    if spec.infinite_plate:
        raise SceneError(
            "run.plate_model = infinite: an infinite plate has no modes. Set run.plate_model = "
            "'modal'."
        )
    limit = 2.0 * np.pi * spec.frequency_limit_hz
    points = spec.contact_point_m, spec.actuator_point_m
    try:
        modes = oscillators(spec.plate, *points, limit, spec.sensor_point_m)
    except ValueError as error:
        raise SceneError(str(error)) from error
    return ModeTable(
        modes.omega,
        np.full(len(modes.omega), modes.eta),
        np.full(len(modes.omega), modes.scale_per_kg),
        modes.contact,
        modes.actuator,
        residual_m_n(spec),
        shape_sensor=modes.sensor,
    )
