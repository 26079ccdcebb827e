"""Which records belong to the same hit: those of one clock, or of the same place in their order."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hertzloop.fitting.records.quantities import QUANTITIES
from hertzloop.fitting.records.record import Record


def group_by_clock(records: Sequence[Record]) -> list[list[Record]]:
    """Return the records of each clock together, in their order; one without a clock is alone."""
    groups: dict[object, list[Record]] = {}
    for one in records:
        groups.setdefault(one.measurement.clock or id(one), []).append(one)
    return list(groups.values())


def number_hits(records: Sequence[Record]) -> list[Record]:
    """Return the records with the number of their hit; those with equal times get a common clock.

    Records of one clock belong to one hit. Of records without a clock the first one of each
    quantity belongs to the first hit, the second one to the second, and so on.
    """
    numbers: dict[object, int] = {}
    counts = dict.fromkeys(QUANTITIES, 0)
    found: list[Record] = []
    for one in records:
        clock = one.measurement.clock
        counts[one.quantity] += not clock
        key = clock or f"\n{counts[one.quantity]}"
        number = numbers.setdefault(key, len(numbers) + 1)
        first = next((r for r in found if r.hit == number), one)
        if clock is None and np.array_equal(first.time_s, one.time_s):
            clock = key
        found.append(replace(one, hit=number, measurement=replace(one.measurement, clock=clock)))
    return found
