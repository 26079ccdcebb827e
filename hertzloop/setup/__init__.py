"""From a scene to everything that a run is made of."""

from hertzloop.setup.setup import Resolvable, Setup, load, parse, resolve

__all__ = ["Resolvable", "Setup", "load", "parse", "resolve"]
