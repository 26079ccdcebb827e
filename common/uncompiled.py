"""The Python function behind a compiled one.

Not beside the decorator of kernels: a file that imports that is taken for one with kernels.
"""

from typing import Any


def plain(function: Any) -> Any:
    """Return the Python function behind a compiled one, or a function as it is."""
    return getattr(function, "py_func", function)
