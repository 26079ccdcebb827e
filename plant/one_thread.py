"""Linear algebra on one thread: on several, sums come in another order and models in other bits.

What is loaded later does as the environment says. NumPy may have been there before.
"""

import os
from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

Given = ParamSpec("Given")
Result = TypeVar("Result")


@cache
def _libraries() -> ThreadpoolController:
    """The libraries of linear algebra that are loaded."""
    return ThreadpoolController().select(user_api="blas")


def on_one_thread(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Let a function's linear algebra run on one thread, and leave what others do as it was."""

    @wraps(function)
    def alone(*given: Given.args, **named: Given.kwargs) -> Result:
        found = _libraries()
        if all(library.num_threads == 1 for library in found.lib_controllers):
            return function(*given, **named)
        with found.limit(limits=1):
            return function(*given, **named)

    return alone
