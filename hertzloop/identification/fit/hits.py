"""Hits of a striker: found in the contact force of a record, split, judged, and numbered."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from hertzloop.identification.records.converter import clipped_samples
from hertzloop.identification.records.errors import RecordError
from hertzloop.identification.records.quantities import QUANTITIES
from hertzloop.identification.records.record import Record
from hertzloop.scene.setup import Setup

FEWEST_BEFORE = 16  # samples between two hits, for the noise
_PULSE, _SURE = 0.05, 8.0  # of the largest force, and noise levels: where a pulse begins
_SMALLER = 0.95  # of the force before: a bounce of a sphere is smaller than the impact before it
_MOVES = 0.05  # of the peak, by which a structure still moves before a hit
_SHOWN = 64  # samples that show it
LONGEST_S = 0.06  # after a hit, that a fit uses: a contact within it belongs to the hit


@dataclass(frozen=True)
class RecordedHit:
    """A hit in a record: the first sample of its pulse, the samples that belong to it, its largest
    force (N), and why it cannot be used, "" if it can."""

    first: int
    samples: slice
    peak_n: float
    defect: str


def find_hits(force: Record, withdrawn: bool, others: Sequence[Record] = ()) -> list[RecordedHit]:
    """Return the hits of a record of the contact force.

    Args:
        force: the record.
        withdrawn: whether a hammer strikes once; else smaller forces afterwards are bounces.
        others: records of the same times, which have to be at rest before a hit.
    """
    value, time_s = force.value, force.time_s
    size = np.abs(value - np.nanmedian(value[: max(len(value) // 50, FEWEST_BEFORE)]))
    quiet = 1.4826 * float(np.nanmedian(size))
    high = np.nan_to_num(size) > max(_PULSE * float(np.nanmax(size)), _SURE * quiet)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], high, [False]]).astype(int)))
    pulses = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 1]
    groups: list[list[tuple[int, int]]] = []
    for first, end in pulses:
        peak = float(np.nanmax(size[first:end]))
        if groups:
            late = time_s[first] - time_s[groups[-1][0][0]] > LONGEST_S
            before = float(np.nanmax(size[slice(*groups[-1][-1])]))
            if not late or not (withdrawn or peak > _SMALLER * before):
                groups[-1].append((first, end))
                continue
        groups.append([(first, end)])
    if not groups:
        return []
    starts = [0] + [
        min(int(np.searchsorted(time_s, time_s[group[-1][0]] + LONGEST_S)), following[0][0])
        for group, following in pairwise(groups)
    ]
    cut, found = clipped_samples(force), []
    for group, start, stop in zip(groups, starts, [*starts[1:], len(value)], strict=True):
        first, end = group[0]
        defect = ""
        if first - start < FEWEST_BEFORE:
            defect = f"{first - start} samples before it, and {FEWEST_BEFORE} are needed"
        elif withdrawn and len(group) > 1:
            after_ms = 1e3 * float(time_s[group[1][0]] - time_s[first])
            defect = f"double hit: the second one follows after {after_ms:.3g} ms"
        elif np.any(cut[first:end]):
            defect = "clipped: its force is at the end of the range"
        for one in () if defect else others:
            rest = one.value[max(start, first - _SHOWN) : first - 2]
            if np.nanstd(rest) > _MOVES * np.nanmax(np.abs(one.value[first:stop])):
                defect = f"{one.quantity} before it: the structure still moves"
        found.append(
            RecordedHit(first, slice(start, stop), float(np.nanmax(size[first:end])), defect)
        )
    return found


def describe_hits(hits: Sequence[RecordedHit], force: Record) -> list[str]:
    """Return sentences on the hits of a record: where, how large, and whether they can be used."""
    return [
        f"{force.name}, hit {number}: {hit.peak_n:.4g} N at {force.time_s[hit.first]:.6g} s, "
        f"{hit.first - hit.samples.start} samples before it; "
        f"{f'not used ({hit.defect})' if hit.defect else 'used'}."
        for number, hit in enumerate(hits, 1)
    ]


def split_hits(records: Sequence[Record], setup: Setup) -> list[Record]:
    """Return the records with one hit each, and the number of the hit of a hammer.

    The channels of a clock are split where their contact force has several hits. Of records without
    a clock the first one of each quantity is the first hit of a hammer, and so on.

    Raises:
        RecordError: none of several hits can be used.
    """
    hammer = setup.scene.hammer
    withdrawn = hammer is not None and not hammer.bounces
    found: list[Record] = []
    for together in _group_by_clock(records):
        force = next((one for one in together if one.quantity == "contact_force"), None)
        others = [
            one for one in together if one is not force and one.quantity not in ("xi", "xi_s")
        ]
        hits = find_hits(force, withdrawn, others) if force is not None else []
        if force is None or len(hits) < 2:
            if hits and hits[0].defect.startswith("double") and force is not None:
                notes = (*force.notes, *describe_hits(hits, force))
                together = [replace(one, notes=notes) if one is force else one for one in together]
            found += together
            continue
        words = describe_hits(hits, force)
        if all(hit.defect for hit in hits):
            raise RecordError(" ".join(words))
        for number, hit in enumerate(hits, 1):
            if hit.defect:
                continue
            for one in together:
                name = f"{one.measurement.clock or one.name}, hit {number}"
                notes, words = (*(one.notes if words else ()), *words), []
                found.append(
                    replace(
                        one,
                        name=f"{one.name}, hit {number}",
                        time_s=one.time_s[hit.samples],
                        value=one.value[hit.samples],
                        measurement=replace(one.measurement, clock=name),
                        notes=notes,
                        hit=1,
                    )
                )
    several = any(one.hit for one in found)
    return _number_hits(found) if hammer is not None or several else found


def _group_by_clock(records: Sequence[Record]) -> list[list[Record]]:
    """Records of one clock together, in their order; a record without one is alone."""
    groups: dict[object, list[Record]] = {}
    for one in records:
        groups.setdefault(one.measurement.clock or id(one), []).append(one)
    return list(groups.values())


def _number_hits(records: Sequence[Record]) -> list[Record]:
    """The records with the number of their hit, and a common clock of those with equal times."""
    numbers: dict[object, int] = {}
    counts = dict.fromkeys(QUANTITIES, 0)
    found: list[Record] = []
    for one in records:
        counts[one.quantity] += not one.measurement.clock
        key = one.measurement.clock or f"\n{counts[one.quantity]}"
        number = numbers.setdefault(key, len(numbers) + 1)
        first = next((r for r in found if r.hit == number), one)
        clock = one.measurement.clock
        if clock is None and np.array_equal(first.time_s, one.time_s):
            clock = key
        found.append(replace(one, hit=number, measurement=replace(one.measurement, clock=clock)))
    return found
