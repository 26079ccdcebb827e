"""Test an active-control law against a simulated impact, at 1 MHz and repeatable to the bit."""

import os

__version__ = "0.3.0"

# Matrices here are small: threads of the linear algebra cost more than they give. NumPy reads
# this once, when it is imported first.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

TYPE_CHECKING = False  # of `typing`, which a program would import before it hears Ctrl-C

# The Python interface, loaded when it is used: a process of a run needs only its part.
__all__ = [  # noqa: F405
    "BudgetRequest",
    "BudgetResult",
    "BusError",
    "Comparison",
    "DesignError",
    "Difference",
    "FitError",
    "FitResult",
    "Impact",
    "ImpactNoise",
    "MarginResult",
    "Record",
    "RecordError",
    "RecordingError",
    "Run",
    "RunFailed",
    "RunMetrics",
    "Scene",
    "SceneError",
    "SpanMetrics",
    "StreamFault",
    "SweepRequest",
    "TuneRequest",
    "TuneResult",
    "WorkersLost",
    "__version__",
    "budget",
    "compare",
    "fit",
    "linear",
    "load",
    "margin",
    "modes",
    "read",
    "read_record",
    "read_records",
    "run",
    "scene_names",
    "simulate",
    "sweep",
    "tune",
    "vary",
]
# Needs gymnasium, so that `from hertzloop import *` leaves it out.
_OF_EXTRAS = ["ImpactEnv"]
if TYPE_CHECKING:
    from hertzloop.api import *  # noqa: F403
    from hertzloop.interop.environment import ImpactEnv as ImpactEnv


def __getattr__(name: str) -> object:
    if name in (*__all__, *_OF_EXTRAS):
        from importlib import import_module

        return getattr(import_module("hertzloop.api"), name)
    raise AttributeError(f"module 'hertzloop' has no attribute '{name}'")


def __dir__() -> list[str]:
    return [*__all__, *_OF_EXTRAS]
