"""Test an active-control law against a simulated impact, at 1 MHz and repeatable to the bit."""

import os
from importlib import import_module as _import_module

from hertzloop.common.version import __version__ as __version__

# Matrices here are small: threads of the linear algebra cost more than they give. NumPy reads
# this once, when it is imported first.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

TYPE_CHECKING = False  # of `typing`, which a program would import before it hears Ctrl-C

if TYPE_CHECKING:
    from hertzloop.api import *  # noqa: F403


def __getattr__(name: str) -> object:
    """Load the Python interface when it is used: a process of a run needs only its part."""
    if name == "__all__" or not name.startswith("_"):
        api = _import_module("hertzloop.api")
        if name == "__all__":
            return [*api.__all__, "__version__"]
        if name in api.__all__:
            return getattr(api, name)
    raise AttributeError(f"module 'hertzloop' has no attribute '{name}'")


def __dir__() -> list[str]:
    return [*_import_module("hertzloop.api").__all__, "__version__"]
