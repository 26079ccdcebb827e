"""The modes of a scene's plant, as a table that another scene can read."""

import numpy as np

from hertzloop.plant.plant import PlantSpec, air_eta
from hertzloop.plant.schemes.collocation import residual_m_n
from hertzloop.plant.structures.mode_file import ModeTable
from hertzloop.plant.structures.structure import oscillator_shapes, oscillators
from hertzloop.results.deflection import axes, refuse_third_mass
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup

_NODES = 441  # of the grid, about
_GRID_MODES = 1200  # at most that many modes go onto a grid


def modes_of_scene(setup: Setup, grid: bool = False) -> ModeTable:
    """Return the modes that a scene's plant computes with, up to its limit: those of equal
    frequency merged, without those that no force moves. With `grid`: their shapes on a grid, too.

    The same run with them gives the same bytes. Raises SceneError.
    """
    spec = setup.plant
    if spec.infinite_plate:
        raise SceneError(
            "the scene takes an infinite plate, which has no modes; set run.plate_model = 'modal'"
        )
    refuse_third_mass(spec, "its modes cannot be written")
    limit = 2.0 * np.pi * spec.frequency_limit_hz
    points = spec.contact_point_m, spec.actuator_point_m
    try:
        modes = oscillators(spec.plate, *points, limit, spec.sensor_point_m)
    except ValueError as error:
        raise SceneError(str(error)) from error
    count = len(modes.omega)
    return ModeTable(
        modes.omega,
        modes.eta + air_eta(spec, modes.omega),
        np.full(count, modes.scale_per_kg),
        modes.contact,
        modes.actuator,
        residual_m_n(spec),
        _on_grid(spec, limit, count) if grid else None,
        modes.sensor,
    )


def _on_grid(
    spec: PlantSpec, limit: float, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    what, points = spec.plate, (spec.contact_point_m, spec.actuator_point_m)
    if what.size_m is None:
        if what.mode_table is not None:
            raise SceneError("the modes come from a file. Use its own grid.")
        raise SceneError(f"{what} has no shapes on a grid; leave out --grid")
    if count > _GRID_MODES:
        raise SceneError(
            f"{count} modes are too many for shapes on a grid; the limit is {_GRID_MODES}. Use a "
            "larger run.accuracy"
        )
    x, y = axes(what.size_m, points[0], _NODES)
    return x, y, oscillator_shapes(what, *points, limit, what.on_grid(limit, x, y))
