"""Find the hits in a record of a force: where each begins, and which samples belong to it."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hertzloop.fitting.records.record import Record
from hertzloop.fitting.records.statistics import robust_deviation

LASTING_S = 0.06  # time after a contact that a fit uses
_CONTACT_SHARE = 0.05  # least force of a contact, over the largest force of the record
_CONTACT_LEVELS = 8.0  # least force of a contact, over the noise
_CONTACT_SAMPLES = 2  # a single sample is a spike
_BASELINE_PARTS = 50  # the first of so many parts of a record gives the force at rest
_LEAST_BASELINE = 16  # samples
_BOUNCE = 0.95  # largest force of a bounce, over that of the contact before it


@dataclass(frozen=True)
class HitRules:
    """Which contacts and samples make one hit, and what a hit needs.

    Args:
        lasting_s: a contact that begins within this time of the one before belongs to its hit, s.
        before_s: samples before a hit that belong to it, s; infinite for all since the hit before.
        fewest_before: number of samples that a hit needs before its first contact.
        bounces: whether a later contact with a smaller force is a bounce of the same hit.
        one_contact: whether a second contact spoils a hit.
    """

    lasting_s: float
    before_s: float
    fewest_before: int
    bounces: bool = False
    one_contact: bool = False


# A fit simulates 60 ms and takes the noise from the samples before a hit. Its sphere bounces; its
# hammer is withdrawn after one contact.
DROPS = HitRules(LASTING_S, math.inf, 16, bounces=True)
HAMMER = HitRules(LASTING_S, math.inf, 16, one_contact=True)
# Modes are fitted to 100 ms of any force. A structure moves long after a hit, so samples far before
# the next one are of no use.
EXCITATION = HitRules(0.1, 0.01, 8)


@dataclass(frozen=True)
class Hit:
    """A hit in a record of a force.

    Args:
        contacts: first sample of each contact and the one after its last.
        samples: the samples that belong to the hit.
        peak_n: largest force of the first contact, N.
        defect: why the hit cannot be used and what to do, "" if it can.
    """

    contacts: tuple[tuple[int, int], ...]
    samples: slice
    peak_n: float
    defect: str = ""

    @property
    def first(self) -> int:
        """The first sample of the first contact."""
        return self.contacts[0][0]

    @property
    def samples_before(self) -> int:
        """How many samples belong to the hit before its first contact."""
        return self.first - self.samples.start


def find_hits(force: Record, rules: HitRules) -> list[Hit]:
    """Return the hits in a record of a force, in their order; they share all of its samples."""
    size = np.abs(force.value - _value_at_rest(force.value))
    groups: list[list[tuple[int, int]]] = []
    for contact in _find_contacts(size):
        if groups and _same_hit(force.time_s, size, groups[-1][-1], contact, rules):
            groups[-1].append(contact)
        else:
            groups.append([contact])
    if not groups:
        return []
    edges = [0]
    samples_before = round(min(rules.before_s / force.interval_s, len(size)))
    for group, following in pairwise(groups):
        ended_s = force.time_s[group[-1][0]] + rules.lasting_s
        ended = int(np.searchsorted(force.time_s, ended_s))
        edges.append(max(ended, following[0][0] - samples_before))
    edges.append(len(size))
    return [
        Hit(tuple(group), slice(start, stop), float(np.nanmax(size[slice(*group[0])])))
        for group, (start, stop) in zip(groups, pairwise(edges), strict=True)
    ]


def _value_at_rest(value: np.ndarray) -> float:
    count = max(len(value) // _BASELINE_PARTS, _LEAST_BASELINE)
    return float(np.nanmedian(value[:count]))


def _find_contacts(size: np.ndarray) -> list[tuple[int, int]]:
    """Return first and end of the runs of samples in which a force is above rest and noise; missing
    samples do not end a run."""
    least = max(
        _CONTACT_SHARE * float(np.nanmax(size)),
        _CONTACT_LEVELS * robust_deviation(size),
    )
    known = np.flatnonzero(np.isfinite(size))
    high = np.concatenate([[False], size[known] > least, [False]])
    runs = np.flatnonzero(np.diff(high.astype(int))).reshape(-1, 2)
    return [(int(known[a]), int(known[b - 1]) + 1) for a, b in runs if b - a >= _CONTACT_SAMPLES]


def _same_hit(
    time_s: np.ndarray,
    size: np.ndarray,
    before: tuple[int, int],
    contact: tuple[int, int],
    rules: HitRules,
) -> bool:
    """Whether a contact belongs to the hit of the contact before it."""
    if time_s[contact[0]] - time_s[before[0]] <= rules.lasting_s:
        return True
    return rules.bounces and bool(
        np.nanmax(size[slice(*contact)]) <= _BOUNCE * np.nanmax(size[slice(*before)])
    )
