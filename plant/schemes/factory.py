"""Plants by the name of their scheme."""

from functools import lru_cache

from hertzloop.plant.plant import Plant, PlantSpec
from hertzloop.plant.schemes.registry import SCHEMES


@lru_cache(maxsize=8)
def built(spec: PlantSpec, scheme: str) -> Plant:
    """A plant whose model is shared by all runs of the same description; not for a scheme that
    keeps the history of a run."""
    found: Plant = SCHEMES[scheme].load()(spec)
    return found


def plant_at_start(spec: PlantSpec, scheme: str, steps: int, touch_phase: float = 0.5) -> Plant:
    """The plant of a run of `steps` steps at its start. Raises ValueError for what the scheme does
    not support."""
    row = SCHEMES[scheme]
    if row.keeps_history:
        found: Plant = row.load()(spec, steps)
        return found
    return built(spec, scheme).at_start(touch_phase)
