"""Where the arrays of a run lie."""

import numpy as np

from hertzloop.plant.schemes.collocation import CollocationPlant, aligned
from tests.plant.rigs import spec


def test_copies_start_at_a_cache_line() -> None:
    for columns in range(1, 20):
        values = np.linspace(0.0, 1.0, 3 * columns).reshape(3, columns)
        placed = aligned(values)
        assert placed.ctypes.data % 64 == 0
        assert placed.flags.c_contiguous
        assert np.array_equal(placed, values)


def test_every_run_has_its_modes_there() -> None:
    plant = CollocationPlant(spec())
    arrays = [plant.model.table, plant.state.z, plant.at_start().state.z]
    assert [array.ctypes.data % 64 for array in arrays] == [0, 0, 0]
