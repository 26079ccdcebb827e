"""Judge the hits of a record: which can be used, and why another one cannot."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hertzloop.fitting.hits.find import Hit, HitRules
from hertzloop.fitting.records.converter import clipped_samples
from hertzloop.fitting.records.record import Record

_AT_REST = 0.05  # largest rms before a hit, over the largest value after it
_REST_SAMPLES = 64  # samples before a hit that show whether a structure is at rest
_MARGIN = 2  # samples just before a hit, in which a filter may ring


def judge_hits(
    hits: Sequence[Hit], force: Record, others: Sequence[Record], rules: HitRules
) -> list[Hit]:
    """Return hits with their defects.

    Args:
        hits: the hits that were found in the force.
        force: the record of the force.
        others: records of the same times, which have to be at rest before a hit.
        rules: what a hit needs.
    """
    clipped = clipped_samples(force)
    return [replace(hit, defect=_defect(hit, force, others, clipped, rules)) for hit in hits]


def _defect(
    hit: Hit, force: Record, others: Sequence[Record], clipped: np.ndarray, rules: HitRules
) -> str:
    defect = few_samples_before(hit.samples_before, rules)
    defect = defect or (double_hit(hit, force) if rules.one_contact else "")
    defect = defect or clipping(clipped[slice(*hit.contacts[0])])
    defect = defect or missing_samples(force.value[slice(*hit.contacts[0])])
    for one in others:
        values = one.value[hit.samples]
        defect = defect or motion_before(values, hit.samples_before, one.quantity)
    return defect


def few_samples_before(count: int, rules: HitRules) -> str:
    """Return what is wrong with so many samples before a hit, "" if they are enough."""
    if count >= rules.fewest_before:
        return ""
    return f"has {count} samples before the hit. Give at least {rules.fewest_before}, at rest."


def clipping(clipped: np.ndarray) -> str:
    """Return what is wrong with the samples of a hit, (samples,) bool, "" if none is clipped."""
    if not np.any(clipped):
        return ""
    return (
        f"has {np.count_nonzero(clipped)} samples that are clipped at the end of the range. "
        "Measure with a larger range, or hit less hard."
    )


def missing_samples(value: np.ndarray) -> str:
    """Return what is wrong with the samples of a contact, (samples,), "" if none is missing."""
    if not np.any(np.isnan(value)):
        return ""
    return (
        f"has {np.count_nonzero(np.isnan(value))} missing samples in its contact. Give a record "
        "without gaps there; a recorder may leave them out beyond its range."
    )


def motion_before(value: np.ndarray, first: int, quantity: str) -> str:
    """Return what is wrong with a structure that still moves before a hit, "" if it is at rest.

    Args:
        value: the samples of the hit, (samples,).
        first: the first one of the contact.
        quantity: of the values.
    """
    before = value[max(0, first - _REST_SAMPLES) : first - _MARGIN]
    share = np.nanstd(before) / np.nanmax(np.abs(value[first:] - np.nanmean(before)))
    if not share > _AT_REST:
        return ""
    return (
        f"is not at rest before the hit: the rms of {quantity} there is {100 * share:.0f} % of its "
        f"largest value, the most is {100 * _AT_REST:g} %. Wait longer between hits."
    )


def double_hit(hit: Hit, force: Record) -> str:
    """Return what is wrong with a second contact of a hit, "" if there is none."""
    if len(hit.contacts) == 1:
        return ""
    return (
        f"is a double hit: a second contact follows after {_second_after_ms(hit, force):.3g} ms. "
        "Withdraw the hammer after a contact."
    )


def _second_after_ms(hit: Hit, force: Record) -> float:
    return 1e3 * float(force.time_s[hit.contacts[1][0]] - force.time_s[hit.first])


def describe_hits(hits: Sequence[Hit], force: Record, striker_known: bool = True) -> list[str]:
    """Return sentences on the hits of a record: where, how large, and whether they can be used.

    Args:
        hits: the hits, with their defects.
        force: the record of the force.
        striker_known: whether a scene tells if a second contact is a bounce or a double hit.
    """
    return [
        f"{force.name}, hit {number}: {hit.peak_n:.4g} N at {force.time_s[hit.first]:.6g} s, "
        f"{hit.samples_before} samples before it; {_outcome(hit, force, striker_known)}"
        for number, hit in enumerate(hits, 1)
    ]


def _outcome(hit: Hit, force: Record, striker_known: bool) -> str:
    if hit.defect:
        return f"not used, since it {hit.defect}"
    if striker_known or len(hit.contacts) == 1:
        return "used."
    return (
        f"a second contact follows after {_second_after_ms(hit, force):.3g} ms: a bounce of a "
        "sphere, or a double hit of a hammer."
    )
