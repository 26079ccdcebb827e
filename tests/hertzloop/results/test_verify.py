"""The check after a run: it sees what a finer model would have changed."""

from dataclasses import replace

import numpy as np
import pytest

from hertzloop.closed_loop.parts import series_under
from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.plant.schemes.factory import built
from hertzloop.plant.time_series import F_A, XI
from hertzloop.results.verification import (
    _START,
    finer_spec,
    verify,
)
from hertzloop.scene.build import build_plant
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from tests.hertzloop.scenes import aluminium_3mm

SHORT = ["run.duration_s=0.0015", "controller.law=off"]


def largest_error(accuracy: str) -> float:
    scene = aluminium_3mm(*SHORT, f"run.accuracy={accuracy}")
    return verify(scene, simulate(scene).truth).largest


def test_a_run_that_meets_its_accuracy():
    fine = largest_error("1e-3")
    assert fine < 1e-3
    assert largest_error("1e-2") < 1e-2
    assert fine < 0.1 * largest_error("1e-1")


LINES = {
    "threshold": [],
    "late, coarse samples": ["controller.latency_us=3", "sensors.every_steps=3"],
    "by chance": [
        "sensors.bits=12",
        "sensors.noise_rms=2e-8",
        "controller.jitter_us=3",
        "controller.drop_out_probability=0.2",
        "run.touch_phase=random",
    ],
    "acceleration": ["controller.law=acceleration_feedback", "sensors.low_pass_hz=1e5"],
}


@pytest.mark.parametrize("name", LINES)
def test_the_loop_on_half_the_step_is_the_same_loop(name):
    """Samples, latency and chance keep the scene's step; the plant, of order 4, alone is finer."""
    scene = aluminium_3mm("run.duration_s=0.0011", "run.accuracy=0.03", *LINES[name])
    spec = scene.plant
    plant = built(replace(spec, step_s=spec.step_s / 2), "modal").at_start()
    plant.state.body[_START] = build_plant(scene, spec).state.body[_START]
    finer = simulate(scene, own_plant=plant, parts_of_step=2).truth
    rows = simulate(scene).truth
    assert np.abs(finer[XI, ::2] - rows[XI]).max() < 1e-4 * -rows[XI].min()
    assert np.array_equal(finer[F_A, ::2], finer[F_A, 1::2])  # a force is held over a step
    assert np.abs(finer[F_A, ::2] - rows[F_A]).max() < 0.01 * rows[F_A].max()


def test_the_law_answers_the_finer_plant():
    """With the forces of the run itself the check would miss what the law makes of an error."""
    scene = aluminium_3mm("run.duration_s=0.0012", "run.accuracy=0.1")
    run, fine = simulate(scene), finer_spec(scene)
    closed = verify(scene, run.truth)
    plant = built(fine, "modal").at_start()
    plant.state.body[_START] = build_plant(scene).state.body[_START]
    forces = np.repeat(run.forces, 2)
    (free,) = impacts_in(fine, series_under(plant, forces))
    (coarse,) = impacts_in(scene.plant, run.truth)
    open_loop = abs(free.plate_energy_j / coarse.plate_energy_j - 1.0)
    assert closed.plate_energy > 1.5 * open_loop


def test_nothing_to_verify():
    scene = aluminium_3mm("run.duration_s=0.0005")
    assert verify(scene, simulate(scene).truth) is None
    published = load("thesis-aluminium")
    with pytest.raises(SceneError, match="does not converge"):
        verify(published, simulate(published).truth)
