"""Time between samples, as facts beside them state it."""

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from hertzloop.fitting.records.errors import TableError
from hertzloop.fitting.records.text.cells import NUMBER
from hertzloop.fitting.records.text.fact_names import (
    INTERVAL_FACTS,
    RATE_FACTS,
    START_FACTS,
    TIME_UNIT_FACTS,
    is_one_of,
    stated_fact,
)
from hertzloop.fitting.records.units import StatedUnit, name_and_unit, unit_of


class StatedSpacing(NamedTuple):
    """Time between samples, s, time of the first one, s, and the name of the fact that says it."""

    step_s: float
    start_s: float
    stated_by: str

    def times(self, count: int) -> np.ndarray:
        """Return the times of so many samples, s, without a second array of that size."""
        found = np.arange(count, dtype=float)
        found *= self.step_s
        found += self.start_s
        return found


def stated_spacing(facts: Mapping[str, Sequence[str]]) -> StatedSpacing | None:
    """Return the time between samples by facts such as `sample_rate`; None if none states it.

    Args:
        facts: cells of each fact, by its plain name.

    Raises:
        TableError: two facts disagree, or one has an unknown unit.
    """
    found: list[tuple[float, str]] = []
    unit = unit_of(stated_fact(facts, TIME_UNIT_FACTS)) or StatedUnit("s", 1.0, "s")
    for name, cells in facts.items():
        stem, own = name_and_unit(name, (*INTERVAL_FACTS, *RATE_FACTS))
        is_rate = is_one_of(stem, RATE_FACTS)
        if not cells or not (is_rate or is_one_of(stem, INTERVAL_FACTS)):
            continue
        parts = re.fullmatch(rf"({NUMBER.pattern})\s*(\D*)", cells[0].strip())
        if parts is None:
            continue
        value = float(parts[1].replace(",", "."))
        given = parts[2] or own or (cells[1] if len(cells) > 1 and unit_of(cells[1]) else "")
        size = unit_of(given) if given else StatedUnit("Hz", 1.0, "Hz") if is_rate else unit
        if size is None or value <= 0.0 or size.si != ("Hz" if is_rate else "s"):
            raise TableError(f"'{name}' = '{cells[0]}' has no known unit of time")
        step = value * size.size
        found.append((1.0 / step if is_rate else step, name))
    if not found:
        return None
    if any(abs(step - found[0][0]) > 1e-3 * step for step, _ in found):
        said = " and ".join(f"'{name}' ({step:.9g} s)" for step, name in found)
        raise TableError(f"{said} disagree about the time between samples")
    start = stated_fact(facts, START_FACTS).replace(",", ".")
    start_s = float(start) * unit.size if NUMBER.fullmatch(start) else 0.0
    step_s, name = found[0]
    return StatedSpacing(step_s, start_s, name)
