"""Contacts of a run, from the samples of its gap and its contact force."""

from dataclasses import dataclass

import numpy as np

from hertzloop.recordings.recording import SampledStream

Span = tuple[int, int]


@dataclass(frozen=True)
class ContactSpan:
    """A contact: position of its first sample and of the first one after it, largest force, N,
    and largest penetration, m."""

    first: int
    end: int
    peak_n: float
    deepest_m: float


def contact_spans(force_n: np.ndarray) -> list[Span]:
    """Return the first step with a contact force and the first one after it, for every contact.

    Args:
        force_n: Contact force, (steps,), N. The gap does not tell: it is below zero over a dent.
    """
    touching = np.concatenate([[0], (force_n != 0.0).astype(np.int8), [0]])
    edges = np.flatnonzero(np.diff(touching))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def contacts_of(truth: SampledStream) -> list[ContactSpan]:
    """Return the contacts of a run."""
    xi, force = truth.arrays.get("xi_m", np.empty(0)), truth.arrays.get("f_c_n", np.empty(0))
    return [
        ContactSpan(a, b, float(force[a:b].max()), -float(xi[a:b].min()))
        for a, b in contact_spans(force)
    ]
