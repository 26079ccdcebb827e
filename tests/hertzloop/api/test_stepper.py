"""The plant step by step: under the forces of a run, its samples are those of the run."""

import runpy

import numpy as np
import pytest

import hertzloop
from hertzloop.scene.setup import load
from tests.hertzloop.own_laws import EXAMPLES, ROOT
from tests.hertzloop.scenes import recorded
from tests.tiers import default

SCENES = ROOT / "tests" / "scenes"
TRIED = (
    "separate-actuator",  # converters, latency, an actuator beside the contact
    "actuator-dynamics",  # bandwidth, mass, dead time, force limit
    "hunt-crossley-jitter",  # latency, jitter, drop-outs
    "sampled-filtered",  # every fifth step, filters, the contact force
    "sensor-elsewhere",  # noise
    "latency-list-clock",
    "yield-pressure",
    "mode-file",
    "infinite",
    "relaxation",
)


@pytest.mark.parametrize("name", default(TRIED, TRIED[:3]))
def test_its_samples_are_those_of_a_recorded_run(name, tmp_path):
    setup = load(str(SCENES / f"{name}.toml"))
    run = recorded(setup, tmp_path / "a.mcap")
    plant = hertzloop.Stepper(setup.scene)
    samples = [plant.sample]
    for force in run.force.arrays["force_n"]:
        plant.step(force)
        if plant.steps_done % setup.sensor.every_steps == 0 and plant.steps_done < plant.steps:
            samples.append(plant.sample)
    assert plant.steps_done == plant.steps == setup.run.steps
    assert np.any(run.force.arrays["force_n"])
    assert np.array(samples).tobytes() == run.daq.values.tobytes()
    assert plant.balance().energy_residual == run.balance.energy_residual


def test_it_refuses_what_no_step_can_be(tmp_path):
    plant = hertzloop.Stepper(hertzloop.load("aluminium-3mm", {"run.duration_s": 2e-6}))
    with pytest.raises(ValueError, match=r"force_n = nan: must be finite"):
        plant.step(float("nan"))
    before = plant.step(0.0)
    assert plant.step(5.0) < before == pytest.approx(0.00098, rel=0.01)
    with pytest.raises(ValueError, match="the 2 steps of the scene are done"):
        plant.step(0.0)


def test_the_example_is_the_loop_of_a_run(shipped_scenes, capsys):
    example = runpy.run_path(str(EXAMPLES / "the_loop.py"))
    run = hertzloop.simulate(example["scene"])
    assert np.array(example["samples"][:-1]).tobytes() == run.samples.values.tobytes()
    assert run.samples.values.max() > 10.0
    shown = capsys.readouterr().out
    assert shown in (ROOT / "docs" / "how-to" / "own-loop.md").read_text()


@pytest.mark.full
def test_the_environment_passes_the_checker():
    checker = pytest.importorskip("gymnasium.utils.env_checker")
    env = runpy.run_path(str(EXAMPLES / "gym_env.py"))["ImpactEnv"]()
    checker.check_env(env)
    env.reset(seed=3)
    shares = {}
    for action in (0.0, 0.5):
        env.reset(seed=3)
        over = False
        while not over:
            force = action if env.plant.sample < 0.0 else 0.0
            _, shares[action], over, _, _ = env.step(np.array([force]))
    assert -1.0 < shares[0.0] < -0.5  # what the plate takes without a force
    assert abs(shares[0.5] - shares[0.0]) > 0.05
