"""What a run leaves out: indicators of whole runs, where they are told, and what changes them."""

from typing import Any

import pytest

from hertzloop.results.effects import neglected_of_scene
from hertzloop.scene.setup import load
from hertzloop.views.run_json import effects_as_json
from tests.commands import invoke, succeed
from tests.hertzloop.scenes import aluminium_3mm, json_in

SHORT = ("run.duration_s=0.0013", "controller.law=off")
LAW = "controller.law=slope_threshold"
LATE = "controller.law=predicted sensors.bits=12 controller.latency_us=15"
HEAVY = "plate.thickness_m=0.001 sphere.radius_m=0.02 sphere.drop_height_m=1 run.duration_s=0.003"
THIN = (
    "plate.thickness_m=0.0002 plate.size_m=[0.1,0.1] plate.contact_point_m=[0.05,0.05] "
    "run.duration_s=0.003"
)


def found(name: str, *settings: str) -> dict[str, dict[str, Any]]:
    data = effects_as_json(neglected_of_scene(load(name, settings)))
    return {finding["name"]: finding for finding in data["validity"]}


def test_the_3_mm_scene_by_hand():
    rows = found("aluminium-3mm", *SHORT)
    # Centre pressure 1.90 GPa against 1.6 x 276 MPa; full at 1.05 GPa of mean pressure.
    assert rows["yield"]["value"] == pytest.approx(1.90 / 0.4416, rel=5e-3)
    assert rows["yield"]["state"] == "out of range"
    for words in ("mean pressure 1.27 GPa", "1.9 GPa in the centre", "442 MPa", "1.05 GPa"):
        assert words in rows["yield"]["sentence"]
    assert rows["plate theory (energy)"]["value"] == pytest.approx(0.085 * 0.64**2, rel=0.02)
    assert rows["plate theory (energy)"]["state"] == "left out"
    assert rows["vibration of the sphere"]["value"] == pytest.approx(13.0, abs=0.15)
    assert rows["large deflection"]["value"] < 0.01
    assert rows["air on the modes"]["value"] == pytest.approx(16.0, rel=0.01)
    for name in ("air around the sphere", "contact against plate"):
        assert rows[name]["state"] == "within"
    assert "delay of the loop" not in rows  # without a law there is no loop


def test_the_20_mm_scene_by_hand():
    rows = found("aluminium-20mm", "controller.law=off")
    # Up to 370 N and 0.58 of the thickness; the plate takes everything, whatever its theory.
    assert rows["large deflection"]["value"] == pytest.approx(0.58, abs=0.01)
    assert rows["large deflection"]["state"] == "left out"
    assert rows["yield"]["value"] == pytest.approx(0.87 / 0.4416, rel=0.01)
    assert rows["yield"]["state"] == "left out"
    assert "plate theory (energy)" not in rows
    assert 0.05 < rows["plate theory (peak)"]["value"] < 0.15


@pytest.mark.parametrize(
    ("name", "explained"),
    [
        ("aluminium-20mm", {"plate theory (peak)"}),
        ("aluminium-3mm", {"plate theory (energy)", "plate theory (peak)"}),
        ("offcentre-6mm", {"plate theory (energy)"}),
        ("oak-20mm", {"yield", "plate theory (peak)"}),
        ("sylomer-20mm", {"contact against sphere", "plate theory (peak)"}),
    ],
)
def test_a_shipped_scene_neglects_what_its_tutorial_explains(shipped_scenes, name, explained):
    """docs/tutorials/first-run.md says why these do not decide."""
    states = {effect: row["state"] for effect, row in found(name).items()}
    assert {effect for effect, state in states.items() if state == "left out"} == explained
    assert "out of range" not in states.values()


@pytest.mark.full
@pytest.mark.parametrize(
    ("settings", "name", "state"),
    [
        ("contact.plasticity=thornton", "yield", "in the model"),
        ("plate.material=sylomer_m", "yield", "not known"),
        ("plate.material=bearing_steel sphere.material=bearing_steel", "yield", "within"),
        ("plate.thickness_m=0.03", "plate theory (energy)", "out of range"),
        (HEAVY, "contact against plate", "left out"),
        (THIN, "large deflection", "out of range"),
        ("plate.loss_factor=0.5", "air on the modes", "within"),
        ("run.plate_model=infinite run.duration_s=0.002", "reflections", "left out"),
        ("sphere.drop_height_m=2", "air around the sphere", "left out"),
        (LAW, "delay of the loop", "within"),
        (f"{LAW} controller.latency_us=4", "delay of the loop", "left out"),
        (f"{LAW} actuator.force_limit_n=30", "force of the actuator", "left out"),
        (LAW, "mass of the actuator", "not known"),
        (f"{LAW} actuator.mass_kg=1e-3", "mass of the actuator", "in the model"),
        (f"{LATE} sensors.full_scale=[-1.2e-5,3e-6]", "range of the sensor", "left out"),
        (f"{LATE} sensors.full_scale=[-1.2e-5,3e-5]", "range of the sensor", "within"),
    ],
)
def test_a_scene_decides_what_it_leaves_out(settings, name, state):
    assert found("aluminium-3mm", *SHORT, *settings.split())[name]["state"] == state


def test_run_inspect_validity_and_sweep_tell_the_same(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    short = ["--set", "run.duration_s=0.0013"]
    told = {}
    for command in (
        ["run", "aluminium-3mm", "--transport", "compiled", "--out", "a.mcap", *short],
        ["inspect", "a.mcap"],
        ["scene", "check", "aluminium-3mm", *short],
    ):
        done = invoke([*command, "--json", "a.json"])
        assert done.exit_code == 0, done.output
        assert "OUT OF RANGE: " in done.output
        assert "Neglected: " in done.output
        told[command[0]] = json_in(tmp_path / "a.json")
    said = [[f["sentence"] for f in data["validity"]] for data in told.values()]
    assert said[0] == said[1] == said[2]
    assert told["run"]["warnings"] == told["scene"]["warnings"]
    assert told["run"]["warnings"][0].startswith("yield: the plate yields")
    over = ["--over", "plate.thickness_m=0.003,0.03", "--out", "s.csv"]
    assert "OUT OF RANGE: yield in 2 of 2 cases, plate theory (energy) in 1 of 2" in succeed(
        "sweep", "aluminium-3mm", *short, *over, "--workers", "1", "--json", "s.json"
    )
    beyond = json_in(tmp_path / "s.json")["out_of_range"]
    assert beyond == {"yield": 2, "plate theory (energy)": 1}


def test_an_unstable_loop_and_a_run_without_contact_have_none():
    unstable = neglected_of_scene(
        load("aluminium-20mm", ["controller.law=velocity_feedback", "controller.kappa=0.4"])
    )
    assert not unstable.stable
    assert not unstable.checks
    early = neglected_of_scene(aluminium_3mm("run.duration_s=0.0005"))
    assert early.stable
    assert effects_as_json(early) == {"validity": [], "warnings": []}
