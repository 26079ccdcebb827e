"""Drive a controller sample by sample or in blocks, and keep everything it says."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from hertzloop.controller import kernels as k
from hertzloop.controller.controller import Controller, Reply, SignalPath
from tests.controller.specs import LawSpec

# kappa s = 4: the command of a penetration p = 1, 4, 9 is exactly 4, 32, 108 N.
SLOPE = LawSpec("slope_threshold", stiffness=8.0, kappa=0.5, v_thr_m_s=-0.25)


@dataclass
class Driven:
    """Streams of a whole run: `forces` by step, up to the last one that became final."""

    forces: np.ndarray
    modes: np.ndarray
    delays: np.ndarray
    replies: list[Reply] = field(repr=False)

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
    look_ahead: bool = False,
) -> Driven:
    """Feed samples in blocks cut at the positions `cuts`; forces are joined from the replies."""
    controller = make(law, line, len(samples), every_steps, seed)
    values = np.array(samples, dtype=float)
    edges = sorted({0, len(samples), *(c for c in cuts if c < len(samples))})
    replies, forces = [], []
    for start, end in pairwise(edges):
        reply = controller.process(values[start:end].copy(), look_ahead)
        assert reply.first_step == sum(map(len, forces))  # without gap or overlap
        assert reply.samples_seen == end
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


def fingerprint() -> str:
    """Hash of all that the kernels put out for a fixed set of runs, kernels compiled or not."""
    digest = hashlib.sha256()
    random = np.random.Generator(np.random.Philox(key=[1, 1]))
    samples = np.concatenate([np.sin(np.arange(150) / 9.0), 0.5 * random.standard_normal(150)])
    lines = [
        SignalPath(),
        SignalPath(latency_steps=3, jitter_steps=4, drop_out_probability=0.2),
        SignalPath(bits=5, full_scale_n=3.0, slew_n_s=0.7),
    ]
    laws = [
        SLOPE,
        replace(SLOPE, window=4),
        replace(SLOPE, law="fade_out", window=4, fade_samples=3),
        replace(SLOPE, law="predicted", lead_samples=4, watch_level=0.5, mass_kg=200.0),
        LawSpec("off", 1.0),
        LawSpec("profile", 1.0, profile_n=(0.3, -2.0, 5.0)),
        LawSpec("force_feedback", 1.0, gain=-2.0),
        LawSpec("acceleration_feedback", 1.0, gain=-2.0, leak_hz=0.01),
    ]
    for law in laws:
        for line in lines:
            for every_steps in (1, 3):
                controller = make(law, line, len(samples), every_steps)
                for start in range(0, len(samples), 50):
                    reply = controller.process(samples[start : start + 50])
                    promise = f"{reply.promise_zero} {reply.promise_level}".encode()
                    for part in (reply.forces, reply.modes, reply.delays, promise):
                        digest.update(part)
                digest.update(controller.law_state.counts)
                digest.update(controller.law_state.record)
                digest.update(controller.line_state.values)
    digest.update(np.array([k.convert_force(controller.line, x) for x in samples]))
    return digest.hexdigest()
