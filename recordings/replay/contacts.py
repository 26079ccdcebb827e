"""Contacts of a run, from the samples of its gap and its contact force."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hertzloop.recordings.joined_stream import Arrays

Span = tuple[int, int]


@dataclass(frozen=True)
class ContactSpan:
    """A contact: position of its first sample and of the first one after it, largest force, N,
    and largest penetration, m."""

    first: int
    end: int
    peak_n: float
    deepest_m: float

    def joined(self, later: "ContactSpan") -> "ContactSpan":
        """Return both as one contact."""
        return ContactSpan(
            self.first,
            later.end,
            max(self.peak_n, later.peak_n),
            max(self.deepest_m, later.deepest_m),
        )


def contact_spans(xi_m: np.ndarray) -> list[Span]:
    """Return the first step in contact and the first one after it, for every contact.

    Args:
        xi_m: Gap, (steps,), m.
    """
    touching = np.concatenate([[0], (xi_m < 0.0).astype(np.int8), [0]])
    edges = np.flatnonzero(np.diff(touching))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def contacts_of(pieces: Iterable[tuple[int, Arrays]]) -> list[ContactSpan]:
    """Return the contacts of a run.

    Args:
        pieces: Pieces of the stream truth, each with the position of its first sample.
    """
    found: list[ContactSpan] = []
    for at, arrays in pieces:
        xi, force = arrays["xi_m"], arrays["f_c_n"]
        for a, b in contact_spans(xi):
            deepest, peak = -float(xi[a:b].min()), float(force[a:b].max())
            contact = ContactSpan(at + a, at + b, peak, deepest)
            if found and found[-1].end == contact.first:
                found[-1] = found[-1].joined(contact)
            else:
                found.append(contact)
    return found
