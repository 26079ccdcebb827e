"""What a reply grants: forces known ahead, and the promise of no force."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hertzloop.controller import law_kernels as laws
from hertzloop.controller.controller import SignalPath
from hertzloop.loop.answering import answer_samples
from tests.controller.drive import SLOPE, drive, make
from tests.controller.specs import LawSpec
from tests.controller.strategies import CUTS, EVERY_STEPS, LATENCIES, LAWS, LINES, SEQUENCES
from tests.controller.test_law import CONSTANT, PROFILE

WITH_LATENCY = st.builds(
    lambda line, latency: SignalPath(**{**vars(line), "latency_steps": latency}), LINES, LATENCIES
)
ONE_BY_ONE = range(1, 200)


@given(LAWS, WITH_LATENCY, SEQUENCES, CUTS, EVERY_STEPS)
@settings(max_examples=200, deadline=None)
def test_forces_granted_ahead_are_those_computed_later(law, line, samples, cuts, every_steps):
    """The forces of each reply are kept as granted, so one that changes later would show."""
    later = drive(law, line, samples, every_steps=every_steps, cuts=ONE_BY_ONE)
    whole = drive(law, line, samples, every_steps=every_steps)
    ahead = drive(law, line, samples, every_steps=every_steps, cuts=cuts, commands_ahead=True)
    finest = drive(
        law, line, samples, every_steps=every_steps, cuts=ONE_BY_ONE, commands_ahead=True
    )
    assert len(ahead.forces) >= len(later.forces)
    assert whole.same_as(later)
    assert ahead.same_as(later)
    assert finest.same_as(later)
    assert ahead.same_as(finest)


@pytest.mark.parametrize(
    ("law", "samples", "known"),
    [
        # Latched with a delay of 3: three stored samples, each one more command.
        (SLOPE, [1, -1, -4, -9, -9], [0, 0, 0, 0, 3]),
        # The contact is over: as many as stored samples are left, and the zero after them.
        (SLOPE, [1, -1, -4, -4, 1, 1, 1], [0, 0, 0, 2, 2, 1, 0]),
        # The rest of the profile and the zero after it.
        (PROFILE, [1, -1, -1, -1, -1], [0, 3, 2, 1, 0]),
        (CONSTANT, [1, 1, -1, 1, 1], [0, 0, 2, 1, 0]),
    ],
)
def test_how_far_a_reply_reaches(law, samples, known):
    """After each sample: how many commands of samples to come the reply has settled."""
    line = SignalPath(latency_steps=5)
    replies = drive(law, line, samples, cuts=ONE_BY_ONE, commands_ahead=True).replies
    settled = [r.first_step + len(r.forces) - (r.samples + 1 + 5) for r in replies]
    # The line shows what the law grants only while the run still has samples to come.
    left = [len(samples) + 60 - r.samples for r in replies]
    assert settled == [min(wanted, most) for wanted, most in zip(known, left, strict=True)]


@pytest.mark.parametrize("samples", [[-1.0] * 6, [1, -1, -4, -9, -9, -9]])
def test_nothing_is_granted_beyond_the_end_of_the_run(samples):
    line = SignalPath(latency_steps=1, jitter_steps=2)
    controller = make(SLOPE, line, len(samples), after=0)
    reply = answer_samples(controller, np.array(samples), commands_ahead=True)
    assert len(reply.forces) == len(samples)
    assert controller.law_state.counts[laws.COMMANDED] == len(samples)


@given(LAWS, WITH_LATENCY, SEQUENCES, CUTS, EVERY_STEPS, st.booleans(), st.data())
@settings(max_examples=200, deadline=None)
def test_the_promise_of_no_force_is_kept(
    law, line, samples, cuts, every_steps, commands_ahead, data
):
    """After any past: the force is zero for as long as later samples stay above the level."""
    controller = make(law, line, len(samples) + 30, every_steps, after=60)
    edges = sorted({0, len(samples), *(c for c in cuts if c < len(samples))})
    for start, end in pairwise(edges):
        reply = answer_samples(controller, np.array(samples[start:end]), commands_ahead)
    if not reply.zero_until_trigger:
        return
    level = max(reply.trigger_level, -1e3)
    above = st.sampled_from([math.nextafter(level, math.inf), level + 0.5, level + 100.0])
    later = data.draw(st.lists(above, min_size=30, max_size=30))
    silent = answer_samples(controller, np.array(later), commands_ahead)
    assert len(silent.forces) >= 30
    assert not silent.forces.any()
    assert silent.zero_until_trigger


@pytest.mark.parametrize("force", [5.0, -5.0])
@pytest.mark.parametrize("chance", [SignalPath(jitter_steps=6), SignalPath(0, 6, 0.3)])
def test_no_promise_while_a_late_force_is_on_its_way(force, chance):
    """A force of one sample, silence before and after: with jitter it acts when law and
    output have long been at zero."""
    law, promised = LawSpec(CONSTANT.law, 1.0, profile_n=(force,)), 0
    for seed in range(40):
        driven = drive(law, chance, [1, 1, -1] + [1] * 12, seed=seed, cuts=ONE_BY_ONE)
        for reply in driven.replies[3:]:
            if reply.zero_until_trigger:
                assert not driven.forces[reply.first_step + len(reply.forces) :].any()
                promised += 1
    assert promised > 100


def promises(law: LawSpec, line: SignalPath, samples: list[float]) -> str:
    """One letter a sample: whether the reply to it promises zero."""
    replies = drive(law, line, samples, cuts=ONE_BY_ONE).replies
    return "".join("y" if r.zero_until_trigger else "." for r in replies)


def test_when_a_promise_is_given():
    contact = [1, -1, -4, -4, 1, 1, 1, 1, 1, 1]
    # Acting until sample 5; the reply to sample 6 holds its zero as the last force.
    assert promises(SLOPE, SignalPath(), contact) == "y.....yyyy"
    # Forces that are on their way are in the reply, too: latency changes nothing.
    assert promises(SLOPE, SignalPath(latency_steps=2), contact) == "y.....yyyy"
    # A slew limit of 20 N a step takes 32 N down in two steps.
    assert promises(SLOPE, SignalPath(slew_n_s=20.0), contact) == "y......yyy"
    # A profile that is over, in a contact that is not: no promise until it ends.
    assert promises(CONSTANT, SignalPath(), [1, -1, -1, -1, -1, 1]) == "y....y"


def test_the_law_off_promises_zero_whatever_comes():
    law = LawSpec("off", 1.0)
    reply = drive(law, SignalPath(), [1, -1, -4], commands_ahead=True).replies[-1]
    assert reply.zero_until_trigger
    assert reply.trigger_level == -math.inf
