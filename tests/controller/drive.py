"""Drive a controller sample by sample or in blocks, and keep everything it says."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from hertzloop.controller.controller import Controller, SignalPath
from hertzloop.loop.answering import AnswerBlock, answer_samples
from tests.controller.specs import LawSpec

# kappa s = 4: the command of a penetration p = 1, 4, 9 is exactly 4, 32, 108 N.
SLOPE = LawSpec("slope_threshold", stiffness=8.0, kappa=0.5, v_thr_m_s=-0.25)


@dataclass
class Driven:
    """Streams of a whole run: `forces` by step, up to the last one that became final."""

    forces: np.ndarray
    modes: np.ndarray
    delays: np.ndarray
    replies: list[AnswerBlock] = field(repr=False)

    def same_as(self, other: "Driven") -> bool:
        """Whether the modes and delays are equal, and the bytes of the forces known to both."""
        count = min(len(self.forces), len(other.forces))
        return (
            self.forces[:count].tobytes() == other.forces[:count].tobytes()
            and np.array_equal(self.modes, other.modes)
            and np.array_equal(self.delays, other.delays)
        )


def make(
    law: LawSpec,
    line: SignalPath,
    samples: int,
    every_steps: int = 1,
    seed: int = 1,
    after: int = 60,
) -> Controller:
    """A controller sampling once a second, for `samples` samples and `after` steps more."""
    steps = samples * every_steps + after
    step_s = 1.0 / every_steps
    bound = law.bound(every_steps * step_s)
    return Controller(bound, line, step_s, steps, every_steps, seed)


def drive(
    law: LawSpec,
    line: SignalPath,
    samples: Sequence[float],
    *,
    every_steps: int = 1,
    seed: int = 1,
    cuts: Sequence[int] = (),
    commands_ahead: bool = False,
) -> Driven:
    """Feed samples in blocks cut at the positions `cuts`; forces are joined from the replies."""
    controller = make(law, line, len(samples), every_steps, seed)
    values = np.array(samples, dtype=float)
    edges = sorted({0, len(samples), *(c for c in cuts if c < len(samples))})
    replies, forces = [], []
    for start, end in pairwise(edges):
        reply = answer_samples(controller, values[start:end].copy(), commands_ahead)
        assert reply.first_step == sum(map(len, forces))  # without gap or overlap
        assert reply.samples == end
        replies.append(reply)
        forces.append(reply.forces.copy())  # as granted: a later change must not hide
    return Driven(
        np.concatenate(forces) if forces else np.empty(0),
        np.concatenate([r.modes for r in replies]),
        np.concatenate([r.delays for r in replies]),
        replies,
    )


def commands(law: LawSpec, samples: Sequence[float]) -> np.ndarray:
    """What the law commands after each sample: with an ideal line, the force a step later."""
    return drive(law, SignalPath(), samples).forces[1:]
