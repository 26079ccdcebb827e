"""Modes of a file that end far below an impact: what stands for the rest, and how far to trust."""

import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.few_modes import Plate, few_modes
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.plant.estimates.model_order import beyond_m_n
from hertzloop.results.effects import EffectState, neglected_of_scene
from hertzloop.scene.build import build_plant
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, load
from tests.commands import succeed
from tests.tiers import default

SIX = (47.1, 96.0, 141.0, 233.0, 301.0, 462.0)
ROW = "modes end below the impact"
HEADER = "frequency_hz,loss_factor,modal_mass_kg,shape_contact"
# A contact of 41 us on six modes up to 462 Hz.
SIX_TOML = """
name = "six"
sphere = {radius_m = 0.0046, drop_height_m = 0.05}
plate = {material = "aluminium", modes = "modes.csv"}
controller.law = "off"
run.duration_s = 0.002
"""
# A support of one mode at 0 Hz.
RIGID_TOML = """
name = "rigid"
sphere = {radius_m = 0.005, drop_height_m = 0.05}
controller.law = "off"
run.duration_s = 0.0015
[plate]
material = "aluminium"
modes = "modes.csv"
tail = "spring"
residual_flexibility_m_n = 0.0
"""


def scene_of(folder: Path, text: str, rows: list[str], settings: tuple[str, ...]) -> Setup:
    (folder / "modes.csv").write_text("\n".join([HEADER, *rows]))
    (folder / "scene.toml").write_text(text)
    return load(str(folder / "scene.toml"), settings)


def six(folder: Path, *settings: str) -> Setup:
    rows = [f"{hz},0.01,0.3,{1.0 - 0.05 * i}" for i, hz in enumerate(SIX)]
    return scene_of(folder, SIX_TOML, rows, settings)


def rigid(folder: Path, *settings: str) -> Setup:
    return scene_of(folder, RIGID_TOML, ["0.0,0.0,1e6,1.0"], settings)


def test_an_infinite_plate_stands_for_the_rest(tmp_path):
    setup = six(tmp_path, "plate.thickness_m=0.003")
    assert rigid_impact(setup.mechanics.sphere, setup.mechanics.contact).contact_s == pytest.approx(
        41e-6, 0.02
    )
    assert setup.plant.damped_residual
    assert setup.expected_error == 0.15
    [found] = [one for one in neglected_of_scene(setup).checks if one.name == ROW]
    assert found.value == setup.expected_error
    assert found.state is EffectState.LEFT_OUT
    assert "the modes end at 462 Hz, and a contact of 41.2 us reaches 2.43e+04 Hz" in found.sentence
    assert re.search(r"right within 15 %.*9[5-8] % of the plate energy does not", found.sentence)


@pytest.mark.parametrize(
    ("flexibility", "words"),
    [("1e-6", "a spring of 1e-06 m/N stands for the rest"), ("0", "nothing stands for the rest")],
)
def test_a_spring_has_to_be_asked_for(flexibility, words, tmp_path):
    known = f"plate.residual_flexibility_m_n={flexibility}"
    with pytest.raises(SceneError, match=r"reach up to 462 Hz, too low.*plate.tail = 'spring'"):
        build_plant(six(tmp_path, known))
    setup = six(tmp_path, known, "plate.tail=spring")
    assert setup.expected_error == 1.0
    [found] = [one for one in neglected_of_scene(setup).checks if one.name == ROW]
    assert found.state is EffectState.OUT_OF_RANGE
    assert words in found.sentence
    assert "impacts may be off by 100 %" in found.sentence


_PUSH = ("controller.law=constant", "controller.force_n=10", "controller.duration_us=10")


@pytest.mark.parametrize("law", [(), _PUSH, ("controller.law=force_feedback",)])
def test_a_rigid_support_leaves_out_nothing(tmp_path, law):
    assert rigid(tmp_path, *law).expected_error == 0.0
    assert rigid(tmp_path, *law, "plate.thickness_m=0.003").expected_error == 0.0
    unknown = rigid(tmp_path, *law, "plate.residual_flexibility_m_n=1e-9")
    assert unknown.expected_error == 1.0


def test_a_rigid_body_has_no_damped_rest(tmp_path):
    setup = rigid(tmp_path, "plate.thickness_m=0.003", "plate.tail=auto")
    assert not setup.plant.damped_residual
    with pytest.raises(
        SceneError, match=r"tail = 'damped': it starts at the last mode.*end at 0 Hz"
    ):
        _ = rigid(tmp_path, "plate.thickness_m=0.003", "plate.tail=damped").plant
    scene = tmp_path / "scene.toml"
    scene.write_text(RIGID_TOML.replace("residual_flexibility_m_n = 0.0\n", ""))
    with pytest.raises(SceneError, match="has modes of a rigid body only"):
        load(str(scene), ["plate.thickness_m=0.003"])


@pytest.mark.parametrize(
    "command",
    default(
        [
            "run SCENE --transport compiled --out a.mcap",
            "scene check SCENE",
            "scene modes SCENE --out a.csv",
            "sweep SCENE --over sphere.drop_height_m=0.03,0.05 --out a.parquet",
            "budget SCENE --law force_feedback --quick --only latency_us --no-real-plant",
        ],
        quick=["scene check SCENE"],
    ),
)
def test_commands_accept_a_rigid_support(command, tmp_path, monkeypatch):
    rigid(tmp_path)
    monkeypatch.chdir(tmp_path)
    succeed(*(word.replace("SCENE", "scene.toml") for word in command.split()))


def test_nothing_beyond_modes_that_reach_far_is_told(tmp_path):
    """The modes are taken to go on as they are: as many in a band, as mobile."""
    hz = np.arange(1, 81) * 1000.0
    rows = [f"{one},0.01,0.3,1.0" for one in hz]
    setup = scene_of(tmp_path, SIX_TOML, rows, ("plate.residual_flexibility_m_n=0",))
    beyond = np.sum(1 / 0.3 / (2 * np.pi * np.arange(81, 200_000) * 1000.0) ** 2)
    assert beyond_m_n(setup.mechanics.structure) == pytest.approx(beyond, rel=0.02)
    [found] = [one for one in neglected_of_scene(setup).checks if one.name == ROW]
    assert 0.0 < found.value < 0.1
    with_rest = load(str(tmp_path / "scene.toml"), ["plate.residual_flexibility_m_n=1e-9"])
    assert not [one for one in neglected_of_scene(with_rest).checks if one.name == ROW]


@pytest.mark.full
def test_first_impacts_on_few_modes_are_as_right_as_expected():
    for found in few_modes(Plate(4.5, 3.0), (6, 25)):
        assert found.error <= found.expected
        assert (found.error < 0.1) == (found.truncated == "infinite plate")
