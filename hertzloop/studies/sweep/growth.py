"""The growth of the linear loop in each case of a sweep."""

import math
from collections.abc import Sequence
from typing import Any

from hertzloop.controller.loading.law import LawError
from hertzloop.controller.loading.registry import find
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.rows import Rows
from hertzloop.studies.margin.growth import growth_of

_NOT_OF_LOOP = ("run.touch_phase", "run.seed", "run.duration_s")  # the linear loop is the same


def with_growth(setup: Setup, keys: Sequence[str], rows: Rows) -> Rows:
    """Return rows with the column `growth_per_s`: the growth of the linear loop in flight, 1/s.

    It is 0 for a stable loop, nan if undecided, and None without a linear loop.
    """
    known: dict[str, float | None] = {}
    without: dict[str, bool] = {}  # laws without a loop
    varied = [key for key in keys if key not in _NOT_OF_LOOP]

    def growth(row: dict[str, Any]) -> float | None:
        law = str(row.get("controller.law", setup.scene.controller.law))
        if law not in without:
            without[law] = _has_no_loop(law)
        if without[law]:
            return None
        values = {key: row[key] for key in varied}
        name = repr(values)  # a value may be a list
        if name not in known:
            try:
                found = growth_of(setup.vary(values))
                undecided = found is not None and found.per_s is None
                known[name] = None if found is None else math.nan if undecided else found.per_s
            except SceneError:
                known[name] = None
            except Exception:  # an error of the analysis must not cost the finished cases
                known[name] = math.nan
        return known[name]

    return [row | {"growth_per_s": growth(row)} for row in rows]


def _has_no_loop(law_reference: str) -> bool:
    """Whether a law makes no linear loop in flight, whatever its constants."""
    try:
        law = find(law_reference)
    except LawError:
        return True
    return bool(law.not_linear) or law.senses == "contact_force"
