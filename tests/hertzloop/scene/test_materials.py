"""Materials: shipped ones, a file of one's own, tables, single numbers; and the labels."""

from dataclasses import replace
from pathlib import Path

import pytest

from hertzloop.plant.structures.materials import MATERIALS, Material
from hertzloop.results.cases import metrics_of_case
from hertzloop.scene.loading import shipped_text
from hertzloop.scene.setup import Setup, load, parse
from hertzloop.scene.toml import to_toml
from tests.hertzloop.scenes import aluminium_3mm

MINE = """
[mine]
young_pa = 1e11
density_kg_m3 = 5000
poisson = 0.25
loss_factor = 1e-3

[lead]
young_pa = 16e9
density_kg_m3 = 11340
poisson = 0.44
"""


def scene_file(folder: Path, materials: str = MINE) -> str:
    (folder / "my_materials.toml").write_text(materials)
    mine = 'materials = "my_materials.toml"\n' + shipped_text("aluminium-3mm")
    (folder / "scene.toml").write_text(mine.replace('material = "aluminium"', 'material = "mine"'))
    return str(folder / "scene.toml")


def plate(scene: Setup) -> Material:
    return scene.plant.plate.material


@pytest.mark.parametrize("name", MATERIALS)
def test_every_shipped_material_can_be_struck_and_fall(name):
    scene = aluminium_3mm(f"plate.material={name}", f"sphere.material={name}")
    spec = scene.plant
    assert spec.plate.material == MATERIALS[name]
    assert spec.sphere.material == MATERIALS[name]


def test_a_file_of_ones_own_goes_into_the_scene(tmp_path):
    scene = load(scene_file(tmp_path))
    assert plate(scene) == Material(1e11, 5000.0, 0.25, 1e-3)
    (tmp_path / "my_materials.toml").unlink()  # nobody needs it any more
    again = parse(to_toml(scene.scene))
    assert again == scene
    assert plate(again.vary({"plate.material": "lead"})) == Material(16e9, 11340.0, 0.44)
    assert again.vary({"sphere.material": "lead"}).plant.sphere.mass_kg == (
        pytest.approx(11340.0 / 7800.0 * again.plant.sphere.mass_kg)
    )


def test_numbers_of_a_material_can_be_set_and_varied(tmp_path):
    table = "{young_pa=1e11, density_kg_m3=5000, poisson=0.25}"
    scene = aluminium_3mm(f"plate.material={table}")
    assert plate(scene) == Material(1e11, 5000.0, 0.25)
    softer = aluminium_3mm("plate.material.young_pa=6e10")
    assert plate(softer) == replace(MATERIALS["aluminium"], youngs_modulus_pa=6e10)
    own = load(scene_file(tmp_path)).vary({"plate.material.poisson": 0.1})
    assert plate(own) == Material(1e11, 5000.0, 0.1, 1e-3)
    heavier = aluminium_3mm("sphere.material.density_kg_m3=15000")
    assert metrics_of_case(heavier).rebound_m_s < metrics_of_case(aluminium_3mm()).rebound_m_s
