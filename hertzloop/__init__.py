"""hertzloop: an impact plant, a force law and a message bus between them, at 1 MHz."""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from hertzloop.extras import sentence_on

__version__ = "0.1.0"

# Matrices here are small: threads of the linear algebra cost more than they give. NumPy reads
# this once, when it is imported first.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The Python interface, loaded when it is used: a process of a run needs only its part.
__all__ = [
    "BusError", "Comparison", "DesignError", "Difference", "Impact", "ImpactNoise",
    "RecordingError", "Run", "RunFailed", "RunFigures", "Scene", "SceneError", "SpanFigures",
    "StreamFault", "SweepFailed", "__version__", "compare", "load", "modes", "read", "run",
    "scene_names", "simulate", "sweep", "tune", "vary",
]  # fmt: skip
if TYPE_CHECKING:
    from hertzloop.interface import BusError as BusError
    from hertzloop.interface import Comparison as Comparison
    from hertzloop.interface import DesignError as DesignError
    from hertzloop.interface import Difference as Difference
    from hertzloop.interface import Impact as Impact
    from hertzloop.interface import ImpactNoise as ImpactNoise
    from hertzloop.interface import RecordingError as RecordingError
    from hertzloop.interface import Run as Run
    from hertzloop.interface import RunFailed as RunFailed
    from hertzloop.interface import RunFigures as RunFigures
    from hertzloop.interface import Scene as Scene
    from hertzloop.interface import SceneError as SceneError
    from hertzloop.interface import SpanFigures as SpanFigures
    from hertzloop.interface import StreamFault as StreamFault
    from hertzloop.interface import SweepFailed as SweepFailed
    from hertzloop.interface import compare as compare
    from hertzloop.interface import load as load
    from hertzloop.interface import modes as modes
    from hertzloop.interface import read as read
    from hertzloop.interface import run as run
    from hertzloop.interface import scene_names as scene_names
    from hertzloop.interface import simulate as simulate
    from hertzloop.interface import sweep as sweep
    from hertzloop.interface import tune as tune
    from hertzloop.interface import vary as vary


def __getattr__(name: str) -> Any:
    if name in __all__:
        try:
            interface = import_module("hertzloop.interface")
        except ModuleNotFoundError as error:
            sentence = sentence_on(error.name)
            raise ImportError(sentence) if sentence else error from None
        return getattr(interface, name)
    raise AttributeError(f"module 'hertzloop' has no attribute '{name}'")


def __dir__() -> list[str]:
    return list(__all__)
