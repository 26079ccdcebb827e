"""Describe a file of records: what was understood, its first samples, and its hits."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hertzloop.fitting.hits.find import DROPS, HAMMER, find_hits
from hertzloop.fitting.hits.judge import describe_hits, judge_hits
from hertzloop.fitting.records.quantities import QUANTITIES
from hertzloop.fitting.records.reading import read_records
from hertzloop.fitting.records.record import Record

# Without a scene the striker is unknown: a second contact may be a bounce.
_ANY_STRIKER = replace(HAMMER, one_contact=False)
_SHOWN = 5  # samples


def describe_file(path: Path) -> list[str]:
    """Return sentences on a file: what was understood, its first samples, and what is not used.

    Raises:
        RecordError: the file cannot be read, or does not say which series are its records.
    """
    records = read_records(path)
    found = [line for one in records for line in _describe_record(one)]
    for force in (one for one in records if one.quantity == "contact_force"):
        others = [one for one in records if one is not force and one.time_s is force.time_s]
        found += _describe_hits(force, others)
    return found


def _describe_hits(force: Record, others: Sequence[Record]) -> list[str]:
    """Return sentences on the hits of a force, unless it is a single one without a defect."""
    hits = judge_hits(find_hits(force, _ANY_STRIKER), force, others, _ANY_STRIKER)
    if len(hits) == 1 and not hits[0].defect and len(hits[0].contacts) == 1:
        return []
    found = describe_hits(hits, force, striker_known=False)
    drops = len(find_hits(force, DROPS))
    if drops < len(hits):
        found.append(
            f"{force.name}: {drops} drop{'s' * (drops != 1)} of a sphere, or {len(hits)} hits of a "
            "hammer. After a drop, a contact with a smaller force is a bounce."
        )
    return found


def _describe_record(one: Record) -> list[str]:
    unit = QUANTITIES[one.quantity].unit
    rows = [
        f"  {t:.9g} s  {v:.6g} {unit}"
        for t, v in zip(one.time_s[:_SHOWN], one.value[:_SHOWN], strict=True)
    ]
    peak = int(np.nanargmax(np.abs(one.value)))
    return [
        f"{one.name}: {one.source}.",
        f"{len(one.value)} samples, {1e6 * one.interval_s:.6g} us from sample to sample; largest "
        f"value {one.value[peak]:.6g} {unit} at {one.time_s[peak]:.9g} s. The first samples:",
        *rows,
        *one.notes,
    ]
