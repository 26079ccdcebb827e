"""The documented examples of what is struck, from an empty folder, and sweeps over all of it."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hertzloop.plant.metrics.impacts import modal_displacement
from hertzloop.plant.structures.structure import oscillators
from hertzloop.recordings.reader import read
from hertzloop.results.deflection import deflection
from hertzloop.results.recorded import truth_of
from hertzloop.scene.setup import load, parse
from tests.commands import as_options, refused, succeed
from tests.hertzloop.own_laws import EXAMPLES


def copied(folder: Path, *names: str) -> None:
    for name in names:
        shutil.copy(EXAMPLES / name, folder)
    for script in (name for name in names if name.endswith(".py")):
        subprocess.run([sys.executable, script], cwd=folder, check=True, timeout=280)


@pytest.mark.full
@pytest.mark.parametrize(
    ("scene", "files", "struck"),
    [
        ("clamped_titanium.toml", ["my_materials.toml"], "a plate with clamped edges"),
        ("beam.toml", ["beam_modes.py"], "the modes of beam.csv"),
        ("l_shaped.toml", ["l_shaped_modes.py"], "the modes of l_shaped.npz"),
    ],
)
def test_example(here: Path, scene: str, files: list[str], struck: str) -> None:
    copied(here, scene, *files)
    told = succeed("run", scene, "--details", "--json", "report.json")
    assert "not defined" in told
    report = json.loads((here / "report.json").read_text())
    assert report["struck"]["name"] == struck
    assert abs(report["residuals"]["energy"]) < 1e-10
    assert abs(report["residuals"]["momentum"]) < 1e-12
    assert report["impacts"][0]["peak_force_n"] > 10.0
    # Rows cannot tell the modes' displacement from that of a damped mode left out, only a spring's.
    spring = ["--set", "plate.tail=spring", "--out", "spring.mcap"]
    succeed("run", scene, *spring)
    # Alone with its recording.
    recording = (here / "spring.mcap").rename(here / "moved.mcap")
    for file in here.iterdir():
        if file != recording:
            file.unlink()
    succeed("inspect", "moved.mcap")
    succeed("replay", "moved.mcap", "--save", "moved.rrd")
    # The contact's node moves as recorded where the shapes are known.
    found = read(recording)
    again = parse(found.scene_toml)
    drawn = deflection(again, found)
    if scene == "beam.toml":
        assert not drawn.w_m.any()
        return
    moved = modal_displacement(again.plant, truth_of(found))
    moved = moved[drawn.times_ns // found.truth.step_ns]
    i, j = drawn.contact_node
    tolerance = 1e-9 if scene == "clamped_titanium.toml" else 1e-6
    assert abs(drawn.w_m[:, i, j] - moved).max() < tolerance * abs(moved).max()


def test_the_beam_of_the_example_is_as_soft_as_a_beam(tmp_path: Path) -> None:
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
m, v, M = setup.sphere.mass_kg, setup.sphere.impact_speed_m_s, own_block.MASS_KG
# Hertz for the reduced mass. The block does not move far enough in the contact to feel its spring.
peak_n = setup.contact.stiffness**0.4 * (1.25 * m * M / (m + M) * v * v) ** 0.6
assert abs(impact.peak_force_n / peak_n - 1.0) < 1e-3
assert abs(impact.rebound_speed_m_s / (v * (M - m) / (M + m)) - 1.0) < 1e-3
# Free vibration of the block after an elastic collision.
w, zeta = math.sqrt(own_block.STIFFNESS_N_M / M), own_block.DAMPING_RATIO
t = np.arange(setup.steps) * setup.step_s - (impact.start_s + 0.5 * impact.duration_s)
turn = w * math.sqrt(1.0 - zeta * zeta)
free = -2.0 * m * v / (m + M) / turn * np.exp(-zeta * w * t) * np.sin(turn * t)
after = t > impact.duration_s
assert np.abs(run.truth[XI_P] - free)[after].max() < 2e-3 * np.abs(free[after]).max()
print("agrees")
"""


@pytest.mark.full
def test_the_block_of_the_example_is_a_mass_on_a_spring(tmp_path: Path) -> None:
    """A structure of one's own from one file, which adds its own row."""
    copied(tmp_path, "own_block.py", "own_block.toml")
    found = subprocess.run(
        [sys.executable, "-c", BLOCK], cwd=tmp_path, capture_output=True, text=True, timeout=280
    )
    assert found.stdout == "agrees\n", found.stderr


@pytest.mark.full
def test_modes_of_a_scene_run_again(here: Path) -> None:
    run = ["run", "aluminium-3mm", "--set", "run.duration_s=0.003", "--transport", "compiled"]
    edges = as_options(["plate.edges=cfsc", "run.accuracy=0.1"])
    succeed("scene", "modes", "aluminium-3mm", *edges, "-o", "modes.csv")
    succeed(*run, *edges, "--out", "plate.mcap")
    succeed(*run, "--set", "plate.modes=modes.csv", "--out", "file.mcap")
    succeed("compare", "plate.mcap", "file.mcap")
    refused("error: ", "scene", "modes", "-o", "modes.txt")
    refused("modes.csv exists", "scene", "modes", "-o", "modes.csv")
    refused("Use an .npz", "scene", "modes", "-o", "other.csv", "--grid")
