"""Linear algebra on one thread: on several, sums come in another order and models in other bits.

What is loaded later does as the environment says. NumPy may have been there before, and the
environment may ask for more.
"""

import os
import sys
from collections.abc import Callable
from functools import cache, lru_cache, wraps
from threading import RLock
from typing import ParamSpec, TypeVar

import numpy as np
from threadpoolctl import ThreadpoolController

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

Given = ParamSpec("Given")
Result = TypeVar("Result")

# The number of threads is one for the whole process: two calls at once would undo each other's.
_alone = RLock()


@cache
def _libraries(with_scipy: bool) -> ThreadpoolController:
    """The libraries of linear algebra that are loaded: NumPy's, and perhaps that of SciPy."""
    return ThreadpoolController().select(user_api="blas")


def _obeyed(found: ThreadpoolController) -> ThreadpoolController:
    """The same, doing as this thread says: threadpoolctl 3.8 passes over, without a word, all but
    the thread that set a limit first."""
    for library in found.lib_controllers:
        if hasattr(library, "clear_controlling_thread"):
            library.clear_controlling_thread(force=True)
    return found


def on_one_thread(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Let a function's linear algebra run on one thread, and leave what others do as it was.

    Whoever calls a function that uses `scipy.linalg` imports that before: a library that is loaded
    within the call is not limited.
    """

    @wraps(function)
    def alone(*given: Given.args, **named: Given.kwargs) -> Result:
        with _alone:
            found = _libraries("scipy.linalg" in sys.modules)
            if all(library.num_threads == 1 for library in found.lib_controllers):
                return function(*given, **named)
            with _obeyed(found).limit(limits=1):
                return function(*given, **named)

    return alone


@lru_cache(maxsize=64)
@on_one_thread
def gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes in (-1, 1) and weights, shape (count,) each; exact up to degree 2 count - 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    nodes.setflags(write=False)
    weights.setflags(write=False)
    return nodes, weights
