"""From a scene to everything that a run is made of."""

from hertzloop.scenes.loading import DEFAULT, shipped
from hertzloop.scenes.tables import FitTable
from hertzloop.scenes.toml import toml_value
from hertzloop.setup.setup import Resolvable, Setup, load, parse, resolve

__all__ = [
    "DEFAULT", "FitTable", "Resolvable", "Setup", "load", "parse", "resolve", "shipped",
    "toml_value",
]  # fmt: skip
