"""Chance is a function of the seed: repeatable, and one source does not move another."""

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.results.cases import metrics_of_case
from tests.hertzloop.scenes import aluminium_3mm

KEYS = ["run.duration_s=0.0013", "run.accuracy=0.05", "controller.v_thr_m_s=-0.6"]
CHANCE = {
    "jitter": ["controller.jitter_us=6"],
    "drop-outs": ["controller.drop_out_probability=0.3"],
    "noise": ["sensors.noise_rms=1e-7"],
}


@pytest.mark.parametrize("name", CHANCE)
def test_a_seed_repeats_and_another_differs(name):
    digests = [
        metrics_of_case(aluminium_3mm(*KEYS, *CHANCE[name], f"run.seed={seed}")).digest
        for seed in (1, 1, 2, 3)
    ]
    assert digests[0] == digests[1]
    assert len(set(digests)) == 3


def test_a_longer_run_begins_with_the_same_chance():
    both = [*KEYS, *(key for keys in CHANCE.values() for key in keys)]
    short = simulate(aluminium_3mm(*both))
    long = simulate(aluminium_3mm(*both, "run.duration_s=0.002"))
    assert np.array_equal(short.truth, long.truth[:, : short.truth.shape[1]])
    assert np.array_equal(short.samples, long.samples[: len(short.samples)])
