"""The documented examples of what is struck, from an empty folder, and sweeps over all of it."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from hertzloop.plant.structures.structure import oscillators
from hertzloop.scene.setup import load
from tests.commands import succeed
from tests.hertzloop.commands import python
from tests.hertzloop.own_laws import EXAMPLES
from tests.hertzloop.scenes import json_in


def copied(folder: Path, *names: str) -> None:
    for name in names:
        shutil.copy(EXAMPLES / name, folder)
    for script in (name for name in names if name.endswith(".py")):
        python(script, cwd=folder)


@pytest.mark.full
@pytest.mark.parametrize(
    ("scene", "files", "struck"),
    [
        ("clamped_titanium.toml", ["my_materials.toml"], "a plate with clamped edges"),
        ("beam.toml", ["beam_modes.py"], "the modes of beam.csv"),
        ("l_shaped.toml", ["l_shaped_modes.py"], "the modes of l_shaped.npz"),
    ],
)
def test_example(here, scene, files, struck):
    copied(here, scene, *files)
    told = succeed("run", scene, "--details", "--json", "report.json")
    assert "radiated energy: known for simply supported plates" in told
    report = json_in(here / "report.json")
    assert report["struck"]["name"] == struck
    assert abs(report["residuals"]["energy"]) < 1e-10
    assert abs(report["residuals"]["momentum"]) < 1e-12
    assert report["impacts"][0]["peak_force_n"] > 10.0
    # Alone with its recording.
    recording = here / f"{Path(scene).stem.replace('_', '-')}.mcap"
    for file in here.iterdir():
        if file != recording:
            file.unlink()
    succeed("inspect", recording)
    succeed("replay", recording, "--save", "alone.rrd")


def test_the_beam_of_the_example_is_as_soft_as_a_beam(tmp_path):
    copied(tmp_path, "beam.toml", "beam_modes.py")
    spec = load(str(tmp_path / "beam.toml")).plant
    limit = 2.0 * np.pi * spec.frequency_limit_hz
    found = oscillators(spec.plate, spec.contact_point_m, spec.actuator_point_m, limit)
    softness = found.scale_per_kg * np.sum((found.contact / found.omega) ** 2)
    softness += spec.plate.residual_flexibility_m_n(limit)
    bending = 210e9 * 0.04 * 0.01**3 / 12.0
    assert softness == pytest.approx((0.31 * 0.49) ** 2 / (3.0 * bending * 0.8), rel=1e-12)
    assert not spec.same_point


BLOCK = """
import math

import numpy as np
import own_block

from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.plant.time_series import XI_P
from hertzloop.scene.setup import load

setup = load("own_block.toml", ["controller.law=off"])
run = simulate(setup)
assert abs(run.balance.energy_residual) < 1e-12
(impact,) = impacts_in(setup.plant, run.truth)
m, v, M = setup.mechanics.sphere.mass_kg, setup.mechanics.sphere.impact_speed_m_s, own_block.MASS_KG
# Hertz for the reduced mass. The block does not move far enough in the contact to feel its spring.
peak_n = setup.mechanics.contact.stiffness**0.4 * (1.25 * m * M / (m + M) * v * v) ** 0.6
assert abs(impact.peak_force_n / peak_n - 1.0) < 1e-3
assert abs(impact.rebound_speed_m_s / (v * (M - m) / (M + m)) - 1.0) < 1e-3
# Free vibration of the block after an elastic collision.
w, zeta = math.sqrt(own_block.STIFFNESS_N_M / M), own_block.DAMPING_RATIO
t = np.arange(setup.run.steps) * setup.run.step_s - (impact.start_s + 0.5 * impact.duration_s)
turn = w * math.sqrt(1.0 - zeta * zeta)
free = -2.0 * m * v / (m + M) / turn * np.exp(-zeta * w * t) * np.sin(turn * t)
after = t > impact.duration_s
assert np.abs(run.truth[XI_P] - free)[after].max() < 2e-3 * np.abs(free[after]).max()
print("agrees")
"""


@pytest.mark.full
def test_the_block_of_the_example_is_a_mass_on_a_spring(tmp_path):
    """A structure of one's own from one file, which adds its own row."""
    copied(tmp_path, "own_block.py", "own_block.toml")
    assert python("-c", BLOCK, cwd=tmp_path).stdout == "agrees\n"
