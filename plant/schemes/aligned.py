"""Arrays that start where a cache line does: a vector of the processor is as long as a line."""

import numpy as np

_LINE = 8  # numbers


def aligned(values: np.ndarray) -> np.ndarray:
    """A copy of an array of floats, C-contiguous, at the start of a cache line.

    Elsewhere, which is where NumPy puts large ones, every vector of eight would be read from two
    lines, and how fast a run is would depend on where its arrays happened to lie.
    """
    room = np.empty(values.size + _LINE)
    address = room.__array_interface__["data"][0]  # `ctypes` takes longer
    first = -(address // room.itemsize) % _LINE
    placed = room[first : first + values.size].reshape(values.shape)
    placed[...] = values
    return placed
