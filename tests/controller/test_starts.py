"""With what a run starts: state and keys of every law, and the random numbers of the line."""

import numpy as np
import pytest

from hertzloop.controller.controller import SignalPath
from hertzloop.controller.loading.records import state_of
from hertzloop.controller.loading.registry import find, shipped
from hertzloop.sensors.acquisition import Sensor, SensorSpec
from tests.controller.drive import make
from tests.controller.test_law import CONSTANT


@pytest.mark.parametrize("name", shipped())
def test_a_law_knows_nothing_before_its_first_sample(name):
    state = state_of(find(name).home)
    assert state.data.size == state.dtype.itemsize // 8
    assert not state.data.any()


@pytest.mark.parametrize("name", shipped())
def test_keys_that_laws_share_have_one_default(name):
    """Another would change the runs of all scenes that leave it out."""
    keys = find(name).keys.model_fields
    for key, value in {"kappa": 0.8, "v_thr_m_s": -0.25}.items():
        assert key not in keys or keys[key].default == value
    assert not find(name).latches or "v_thr_m_s" in keys


def test_random_numbers_are_those_of_all_earlier_runs():
    """A stream of its own for noise, jitter and drop-outs: recordings are repeated to the bit by
    later versions, too."""

    def numbers(stream: int) -> np.random.Generator:
        return np.random.Generator(np.random.Philox(key=[7, stream]))

    noise = Sensor(SensorSpec(noise_rms=2.0, every_steps=2), 1e-6, 50, seed=7).model.noise
    assert np.array_equal(noise, 2.0 * numbers(1).standard_normal(25))
    both = SignalPath(jitter_steps=5, drop_out_probability=0.3)
    line = make(CONSTANT, both, 50, seed=7, after=0).path
    assert np.array_equal(line.added_steps, numbers(2).integers(0, 6, 50))
    assert np.array_equal(line.dropped, numbers(3).random(50) < 0.3)
