"""From a scene to everything that a run is made of."""

from hertzloop.setup.setup import Setup, load, parse, resolve

__all__ = ["Setup", "load", "parse", "resolve"]
