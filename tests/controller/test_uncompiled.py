"""The kernels are plain Python as well: without compilation they give the same bits."""

import hashlib
import os
from dataclasses import replace

import numpy as np

from hertzloop.controller import kernels as k
from hertzloop.controller.controller import SignalPath
from hertzloop.loop.answering import answer_samples
from tests.controller.drive import SLOPE, make
from tests.controller.specs import LawSpec
from tests.hertzloop.commands import python
from tests.hertzloop.own_laws import ROOT

SCRIPT = """
import numba
from tests.controller.test_uncompiled import fingerprint
assert numba.config.DISABLE_JIT
print(fingerprint())
"""


def fingerprint() -> str:
    """Hash of all that the kernels put out for a fixed set of runs, kernels compiled or not."""
    digest = hashlib.sha256()
    random = np.random.Generator(np.random.Philox(key=[1, 1]))
    samples = np.concatenate([np.sin(np.arange(150) / 9.0), 0.5 * random.standard_normal(150)])
    lines = [
        SignalPath(latency_steps=3, jitter_steps=4, drop_out_probability=0.2),
        SignalPath(bits=5, full_scale_n=3.0, slew_n_s=0.7),
    ]
    laws = [
        SLOPE,
        replace(SLOPE, law="fade_out", window=4, fade_samples=3),
        replace(SLOPE, law="predicted", lead_samples=4, watch_level=0.5, mass_kg=200.0),
        LawSpec("profile", 1.0, profile_n=(0.3, -2.0, 5.0)),
        LawSpec("acceleration_feedback", 1.0, gain=-2.0, leak_hz=0.01),
    ]
    for law in laws:
        for line in lines:
            for every_steps in (1, 3):
                controller = make(law, line, len(samples), every_steps)
                for start in range(0, len(samples), 50):
                    reply = answer_samples(controller, samples[start : start + 50])
                    promise = f"{reply.zero_until_trigger} {reply.trigger_level}".encode()
                    for part in (reply.forces, reply.modes, reply.delays, promise):
                        digest.update(part)
                digest.update(controller.law_state.counts)
                digest.update(controller.law_state.record)
                digest.update(controller.path_state.values)
    digest.update(np.array([k.convert_force(controller.path, x) for x in samples]))
    return digest.hexdigest()


def test_compiled_and_uncompiled_give_the_same_bits():
    uncompiled = python("-c", SCRIPT, env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, cwd=ROOT)
    assert uncompiled.stdout.strip() == fingerprint()
