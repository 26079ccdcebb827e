"""What is struck, from scene to recording: edges, files of modes, materials of one's own."""

import importlib
import sys
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

import hertzloop
from hertzloop.plant.structures.mode_file import SUFFIXES, write_modes
from hertzloop.plant.structures.registry import STRUCTURES, Kind
from hertzloop.recordings.compare import first_difference
from hertzloop.results.deflection import deflection
from hertzloop.results.recorded import truth_of
from hertzloop.results.scene_modes import modes_of_scene
from hertzloop.scene.build import build_plant
from hertzloop.scene.controller import build_controller
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import shipped, shipped_text
from hertzloop.scene.setup import Setup, load, parse, resolve
from hertzloop.studies.margin.flight import margin_of
from tests.hertzloop.own_laws import EXAMPLES
from tests.hertzloop.scenes import aluminium_3mm, recorded

SHORT = ["run.duration_s=0.002"]
CONSISTENT = [name for name in shipped() if not name.startswith("thesis")]


@pytest.mark.parametrize(("name", "suffix"), list(zip(CONSISTENT, cycle(SUFFIXES), strict=False)))
def test_a_file_made_from_a_plate_gives_the_bytes_of_the_plate(tmp_path, name, suffix):
    scene = load(name, ["run.duration_s=0.012"])
    file = tmp_path / f"modes{suffix}"
    file.write_bytes(write_modes(suffix, modes_of_scene(scene)))
    by_file = load(name, ["run.duration_s=0.012", f"plate.modes={file}"])
    one, other = (recorded(of, tmp_path / f"{of is scene}.mcap") for of in (scene, by_file))
    assert first_difference(one, other) is None
    assert truth_of(one)[4].max() > 0.0


def test_a_free_plate_is_driven_away_as_a_rigid_body(tmp_path):
    """What the forces give a free plate is momentum: m v of its mean deflection."""
    scene = aluminium_3mm(
        *SHORT,
        "plate.edges=ffff",
        "controller.law=off",
        "run.accuracy=0.1",
        "plate.size_m=[0.1, 0.08]",
        "plate.contact_point_m=[0.05, 0.04]",
    )
    recording = recorded(scene, tmp_path / "a.mcap")
    rows, h = truth_of(recording), scene.run.step_s
    plate = deflection(scene, recording, frames=np.array([1900, 1999]))
    weights = np.outer(np.gradient(plate.x_m), np.gradient(plate.y_m))
    weights[[0, -1]] *= 0.5
    weights[:, [0, -1]] *= 0.5
    mean = np.tensordot(plate.w_m, weights, 2) / weights.sum()
    speed = (mean[1] - mean[0]) / (99 * h)
    mass = 2700.0 * 0.003 * 0.1 * 0.08
    assert mass * speed == pytest.approx(-rows[4].sum() * h, rel=0.01)


MODES = """frequency_hz,loss_factor,modal_mass_kg,shape_contact
30000,0.01,0.4,1.0
90000,0.02,0.4,-0.9
"""


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (
            ["plate.edges=cccc"],
            "plate.edges = 'cccc': has no effect with plate.modes. Leave one of them out.",
        ),
        (
            ["plate.loss_factor=0.1"],
            "plate.loss_factor = 0.1: has no effect with plate.modes. Leave one of them out.",
        ),
        (["run.scheme=thesis2008"], "supports a simply supported plate only"),
        (["plate.thickness_m=0.3"], "times as mobile as an infinite plate"),
    ],
)
def test_what_does_not_go_with_a_file_of_modes(tmp_path, settings, words):
    rows = [f"{20000 + 8000 * i},{0.01 * i},0.01,1.0" for i in range(10)]
    (tmp_path / "m.csv").write_text("\n".join([MODES.splitlines()[0], *rows]))
    with pytest.raises(SceneError) as caught:
        build_plant(aluminium_3mm(f"plate.modes={tmp_path / 'm.csv'}", *settings))
    assert words in str(caught.value), str(caught.value)
    assert "\n" not in str(caught.value)


def modes_alone(tmp_path: Path) -> str:
    """A shipped scene on the modes of m.csv, which need not be those of a plate."""
    lines = [
        line
        for line in shipped_text("aluminium-3mm").splitlines()
        if not line.startswith(("size_m", "thickness_m", "contact_point_m"))
    ]
    plain = "\n".join(lines).replace("[plate]", '[plate]\nmodes = "m.csv"')
    (tmp_path / "scene.toml").write_text(plain)
    return str(tmp_path / "scene.toml")


def test_modes_too_low_for_an_impact_follow_the_advice_and_do_for_flight(tmp_path):
    def up_to(highest_hz: float) -> Setup:
        rows = [f"{highest_hz * (i + 1) / 5:.6f},0.01,0.4,1.0" for i in range(5)]
        text = "\n".join(["# residual_flexibility_m_n = 1e-9", MODES.splitlines()[0], *rows])
        (tmp_path / "m.csv").write_text(text)
        law = ["controller.law=linear", "controller.numerator=[-0.01]", "sensors.quantity=v_p"]
        return load(modes_alone(tmp_path), law)

    with pytest.raises(
        SceneError, match=r"reach up to 4,000 Hz.*give modes up to ([\d,]+) Hz"
    ) as e:
        build_plant(up_to(4000.0))
    advice = float(str(e.value).partition("modes up to ")[2].split()[0].replace(",", ""))
    build_plant(up_to(advice))
    with pytest.raises(SceneError, match="too low for an impact"):
        build_plant(up_to(0.99 * advice))
    assert len(hertzloop.linear(up_to(4000.0)).poles) >= 5
    assert margin_of(up_to(4000.0)).applicable


def test_laws_that_need_an_impedance_say_so(tmp_path):
    (tmp_path / "m.csv").write_text("# residual_flexibility_m_n = 1e-9\n" + MODES)
    file = modes_alone(tmp_path)
    scene = load(file)
    build_controller(scene)
    for law in ("shifted_threshold", "predicted", "velocity_feedback"):
        with pytest.raises(SceneError, match=r"Give plate\.thickness_m"):
            build_controller(load(file, [f"controller.law={law}"]))
        build_controller(load(file, [f"controller.law={law}", "plate.thickness_m=0.003"]))


def test_a_point_may_lie_near_an_edge_that_is_free():
    aluminium_3mm("plate.edges=fccc", "plate.contact_point_m=[1e-6, 0.2]")


@pytest.mark.parametrize("key", ["size_m", "thickness_m"])
def test_a_plate_without_modes_needs_its_sizes(key):
    text = shipped_text("aluminium-3mm")
    lines = [line for line in text.splitlines() if not line.startswith(key)]
    with pytest.raises(SceneError, match=f"plate.{key}: is missing"):
        parse("\n".join(lines))


def test_an_actuator_that_modes_put_elsewhere_is_in_the_truth(tmp_path):
    """The file says where the actuator is; the scene names no point of its own."""
    apart = ["plate.actuator_point_m=[0.3, 0.2]", "run.accuracy=0.1"]
    table = modes_of_scene(aluminium_3mm(*SHORT, *apart))
    (tmp_path / "apart.npz").write_bytes(write_modes(".npz", table))
    scene = aluminium_3mm(*SHORT, f"plate.modes={tmp_path / 'apart.npz'}")
    assert scene.scene.plate.actuator_point_m is None
    assert not scene.mechanics.same_point
    memory = hertzloop.simulate(scene.scene)
    assert np.abs(memory.truth["xi_a_m"] - memory.truth["xi_p_m"]).max() > 1e-9
    recorded = hertzloop.run(scene.scene, transport="inprocess")
    assert recorded.truth.identical(memory.truth)
    assert recorded.impacts == memory.impacts


def test_a_structure_follows_its_module(tmp_path, monkeypatch):
    """Once it is reloaded, in a process that has resolved the same scene before."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.setitem(STRUCTURES, "block", Kind("own_block:made"))
    text = (EXAMPLES / "own_block.py").read_text()
    (tmp_path / "own_block.py").write_text(text)
    module = importlib.import_module("own_block")
    scene = load(str(EXAMPLES / "own_block.toml")).scene
    assert resolve(scene).mechanics.structure is resolve(scene).mechanics.structure
    assert resolve(scene).mechanics.structure.mass_kg == 0.05
    (tmp_path / "own_block.py").write_text(text.replace("RATIO = 0.05,", "RATIO = 0.02,"))
    importlib.reload(module)
    assert resolve(scene).mechanics.structure.mass_kg == 0.02
    del sys.modules["own_block"]
