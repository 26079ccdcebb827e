"""Kinds of plant with kernels of their own: a recording and a verification know each."""

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.results.deflection import deflection
from hertzloop.results.recorded import truth_of
from hertzloop.results.verification import verify
from tests.hertzloop.scenes import aluminium_3mm, recorded
from tests.tiers import default

SHORT = ("run.duration_s=0.0013", "run.plate_model=modal")
KINDS = {
    "damped": ["plate.tail=damped"],
    "actuator": ["actuator.bandwidth_hz=1e5", "actuator.mass_kg=1e-3"],
    "yields": ["contact.plasticity=thornton", "contact.limiting_pressure_pa=1.05e9"],
}


@pytest.mark.parametrize("kind", default(KINDS, ["damped"]))
def test_a_recording_holds_the_rows_and_the_check_confirms_them(kind, tmp_path):
    scene = aluminium_3mm(*SHORT, *KINDS[kind])
    recording, done = recorded(scene, tmp_path / "a.mcap"), simulate(scene)
    assert np.array_equal(truth_of(recording), done.truth)
    assert recording.balance.modal_dissipated_j == done.balance.modal_dissipated_j
    found = verify(scene, done.truth)
    assert found.rebound_speed < 1e-3
    assert max(found.penetration, found.plate_energy) < 1e-3
    moved = deflection(scene, recording, np.array([1040]))
    at = np.unravel_index(np.argmax(np.abs(moved.w_m[0])), moved.w_m[0].shape)
    assert abs(moved.x_m[at[0]] - 0.25) + abs(moved.y_m[at[1]] - 0.25) < 0.05
