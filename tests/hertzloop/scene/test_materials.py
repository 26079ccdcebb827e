"""Materials: shipped ones, a file of one's own, tables, single numbers; and the labels."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest

from hertzloop.plant.structures.materials import MATERIALS, Material
from hertzloop.results.cases import metrics_of_case
from hertzloop.scene.build import build_plant
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, load, parse
from hertzloop.scene.toml import to_toml

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
    text = Path(__file__).parents[3] / "hertzloop/scene/aluminium-3mm.toml"
    mine = 'materials = "my_materials.toml"\n' + text.read_text()
    (folder / "scene.toml").write_text(mine.replace('material = "aluminium"', 'material = "mine"'))
    return str(folder / "scene.toml")


def plate(scene: Setup) -> Material:
    return scene.plant.plate.material


@pytest.mark.parametrize("name", MATERIALS)
def test_every_shipped_material_can_be_struck_and_fall(name: str) -> None:
    ball = "steel" if MATERIALS[name].orthotropic else name  # which a plate alone can be
    scene = load("aluminium-3mm", [f"plate.material={name}", f"sphere.material={ball}"])
    spec = scene.plant
    assert spec.plate.material == MATERIALS[name]
    assert spec.sphere.material == MATERIALS[ball]


def test_a_file_of_ones_own_goes_into_the_scene(tmp_path: Path) -> None:
    scene = load(scene_file(tmp_path))
    assert plate(scene) == Material(1e11, 5000.0, 0.25, 1e-3)
    (tmp_path / "my_materials.toml").unlink()  # nobody needs it any more
    again = parse(to_toml(scene.scene))
    assert again == scene
    assert plate(again.vary({"plate.material": "lead"})) == Material(16e9, 11340.0, 0.44)
    assert again.vary({"sphere.material": "lead"}).plant.sphere.mass_kg == (
        pytest.approx(11340.0 / 7800.0 * again.plant.sphere.mass_kg)
    )


def test_numbers_of_a_material_can_be_set_and_varied(tmp_path: Path) -> None:
    table = "{young_pa=1e11, density_kg_m3=5000, poisson=0.25}"
    scene = load("aluminium-3mm", [f"plate.material={table}"])
    assert plate(scene) == Material(1e11, 5000.0, 0.25)
    softer = load("aluminium-3mm", ["plate.material.young_pa=6e10"])
    assert plate(softer) == replace(MATERIALS["aluminium"], youngs_modulus_pa=6e10)
    own = load(scene_file(tmp_path)).vary({"plate.material.poisson": 0.1})
    assert plate(own) == Material(1e11, 5000.0, 0.1, 1e-3)
    heavier = load("aluminium-3mm", ["sphere.material.density_kg_m3=15000"])
    assert metrics_of_case(heavier).rebound_m_s < metrics_of_case(load("aluminium-3mm")).rebound_m_s


@pytest.mark.parametrize(("speed_m_s", "is_one"), [(9.99, False), (10.01, True), (40_000.5, False)])
def test_sound_is_as_fast_as_in_solids(speed_m_s: float, is_one: bool) -> None:
    """From 10 m/s, the softest gel, to 40 km/s, beyond diamond."""
    table = f"{{young_pa={1e3 * speed_m_s**2!r}, density_kg_m3=1e3, poisson=0.3}}"
    with nullcontext() if is_one else pytest.raises(SceneError, match="make a speed of sound of"):
        load("aluminium-3mm", [f"sphere.material={table}"])


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("plate.material=cheese", "plate.material = 'cheese': unknown material. Use one of steel"),
        ("sphere.material.density_kg_m3=-7800", "sphere.material.density_kg_m3 = -7800"),
        ("plate.material.young_pa=nan", "plate.material.young_pa = nan: must be"),
        ("plate.material.young_pa=72", "plate.material.young_pa = 72: must be 1e3"),
        ("plate.material.young_pa=72000", "make a speed of sound of 5.16 m/s"),
        ("plate.material.colour=3", "plate.material.colour is not a property of a material"),
        ("plate.material={young_pa=1e11}", "plate.material.density_kg_m3 is missing"),
        ("materials=none.toml", "materials = 'none.toml': cannot be read"),
        ("plate.modes=none.csv", "plate.modes = 'none.csv': cannot be read: No such file"),
        ("plate.modes=none.txt", "unknown format. Use a file that ends in .csv, .parquet, .npz"),
        ("plate.residual_flexibility_m_n=1e-9", "needs plate.modes"),
    ],
)
def test_refused_with_a_sentence(setting: str, words: str) -> None:
    with pytest.raises(SceneError) as caught:
        build_plant(load("aluminium-3mm", [setting]))
    assert words in str(caught.value), str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 700


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[mine]\nyoung_pa = 1e11", "mine.density_kg_m3 is missing"),
        ("[mine", "is not valid TOML"),
        (MINE.replace("0.25", "0.6"), "mine.poisson = 0.6: must be"),
    ],
)
def test_a_wrong_file_of_materials(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(SceneError, match=r"my_materials\.toml") as caught:
        load(scene_file(tmp_path, text))
    assert words in str(caught.value)
