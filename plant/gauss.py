"""Gauss's rule, worked out once for each number of nodes: eigenvalues take milliseconds."""

from functools import lru_cache

import numpy as np

from plant.one_thread import on_one_thread


@lru_cache(maxsize=64)
@on_one_thread
def gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes in (-1, 1) and weights, shape (count,) each; exact up to degree 2 count - 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    nodes.setflags(write=False)
    weights.setflags(write=False)
    return nodes, weights
