"""A structure of one's own whose modes are a table: arrays in its fields."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
TABLE = """
from dataclasses import dataclass

import numpy as np
from own_beam import Beam, made

@dataclass(frozen=True)
class TableBeam(Beam):
    {field}

def table(description):
    beam = made(description)
    return TableBeam(**vars(beam), {value})
"""
# One program, since a structure is added to the table of a process.
SCRIPT = """
import hertzloop
from hertzloop.plant.structures.registry import STRUCTURES, Kind

STRUCTURES.update(beam=Kind("own_beam:made"), array=Kind("array_beam:table"),
                  listed=Kind("listed_beam:table"))
for theory in STRUCTURES:
    if theory not in ("beam", "array", "listed"):
        continue
    scene = hertzloop.load("own_beam.toml", {"plate.theory": theory, "contact.plasticity": "none"})
    energy_j = hertzloop.simulate(scene).metrics.first_impact.plate_energy_j
    swept = hertzloop.sweep(scene, {"controller.latency_us": [0, 2]}).plate_energy_db.values
    print(energy_j, *swept)
"""


@pytest.fixture
def beams(tmp_path) -> Path:
    """A folder with the example, and the same beam with a table of its own."""
    for name in ("own_beam.py", "own_beam.toml"):
        shutil.copy(EXAMPLES / name, tmp_path)
    array = TABLE.format(field="table: np.ndarray", value="table=np.arange(5.0)")
    (tmp_path / "array_beam.py").write_text(array)
    listed = TABLE.format(field="table: list", value="table=[np.eye(2), {'x': 1.0}]")
    (tmp_path / "listed_beam.py").write_text(listed)
    return tmp_path


def test_a_table_of_its_own_changes_nothing(beams):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=beams, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr[-2000:]
    beam, array, listed = done.stdout.splitlines()
    assert beam == array == listed
    assert float(beam.split()[0]) == pytest.approx(0.489429e-3, rel=1e-6)
