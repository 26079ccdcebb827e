"""The page "Modes from a measurement", followed literally."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hertzloop.plant.structures.mode_file import read_modes
from hertzloop.results.scene_modes import modes_of_scene
from hertzloop.scene.setup import load

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE = (DOCS / "how-to" / "measured-structures.md").read_text("utf-8")
EXAMPLE = DOCS / "examples" / "hammer"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the folder that the page names."""
    return shutil.copytree(EXAMPLE, tmp_path / "hammer")


def followed(line: str, folder: Path) -> str:
    """Run a command of the page; what it prints."""
    assert f"\n{line}\n" in PAGE
    place = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "-c", line], cwd=folder, env=place, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.full
def test_hits_become_a_mode_file_a_scene_and_a_run(folder):
    pytest.importorskip("sdypy")
    assert followed("python modes.py", folder) in PAGE
    assert "reduces plate energy by 2 dB" in followed("hertzloop run structure.toml", folder)
    budget = 'hertzloop budget structure.toml --goal "plate_energy_db < -0.5" --only latency_us'
    assert "latency" in followed(budget, folder)


@pytest.mark.full
def test_modes_of_a_universal_file_are_those_that_were_written(folder):
    pyuff = pytest.importorskip("pyuff")
    known = modes_of_scene(load("offcentre-6mm", ["run.accuracy=0.05"]))
    hz, mass_kg = known.omega_rad_s / (2 * np.pi), 1 / known.per_modal_mass_1_kg
    loss = (known.loss_factor + 0 * hz).tolist()
    flat = np.zeros(2)
    sets = [
        pyuff.prepare_55(
            model_type=1, id1="NONE", id2="NONE", id3="NONE", id4="NONE", id5="NONE",
            analysis_type=2, data_ch=2, spec_data_type=8, load_case=0, mode_n=i + 1,
            freq=float(hz[i]), modal_m=float(mass_kg[i]) / 1e3, modal_damp_vis=loss[i] / 4,
            modal_damp_his=loss[i] / 2, node_nums=[12, 14], r1=flat, r2=flat,
            r3=np.array([known.shape_contact[i], known.shape_actuator[i]]),
        )
        for i in range(len(hz))
    ]  # fmt: skip
    pyuff.UFF(str(folder / "plate.unv")).write_sets(sets, "overwrite")
    subprocess.run([sys.executable, "from_uff.py"], cwd=folder, check=True, timeout=60)
    found = read_modes("plate.csv", (folder / "plate.csv").read_bytes())
    assert found.omega_rad_s == pytest.approx(known.omega_rad_s, rel=2e-5)
    assert found.loss_factor == pytest.approx(np.array(loss), rel=2e-5)
    assert found.per_modal_mass_1_kg == pytest.approx(known.per_modal_mass_1_kg, rel=2e-5)
    for name in ("shape_contact", "shape_actuator"):
        assert getattr(found, name) == pytest.approx(getattr(known, name), rel=1e-4, abs=1e-5)
