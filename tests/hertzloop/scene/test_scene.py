"""Scenes: what is accepted, and the sentences for what is not."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hertzloop.loop.simulate import simulate
from hertzloop.results.cases import metrics_of_case
from hertzloop.results.metrics import metrics_of
from hertzloop.results.verification import check_verifiable
from hertzloop.scene import model_error
from hertzloop.scene.build import build_plant
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT, load, parse, shipped
from hertzloop.scene.setup import resolve
from hertzloop.scene.toml import to_toml, toml_value
from hertzloop.scene.varying import vary


def test_the_scenes_that_come_with_it() -> None:
    names = {"aluminium-3mm", "aluminium-20mm", "oak-20mm", "sylomer-20mm", "offcentre-6mm"}
    names |= {"thesis-aluminium", "thesis-oak", "thesis-sylomer"}
    assert set(shipped()) == names
    assert shipped()[0] == DEFAULT == "aluminium-20mm"
    for name in names:
        scene = load(name)
        assert scene.name == name
        assert scene.shows
        build_plant(resolve(scene))
    default = load(DEFAULT)
    assert (default.sphere.radius_m, default.sphere.drop_height_m) == (0.02, 0.05)


@pytest.mark.parametrize("name", shipped())
def test_what_is_recorded_is_the_same_scene(name: str) -> None:
    settings = [
        "sensors.noise_rms=1.25e-7", "controller.bits=12", "run.seed=77",
        "controller.full_scale_n=100", "controller.law=profile", "controller.profile_n=[1.5, -2.0]",
    ]  # fmt: skip
    scene = load(name, settings)
    assert scene.controller.profile_n == (1.5, -2.0)
    assert parse(to_toml(scene)) == scene


@settings(max_examples=40)
@given(st.text(max_size=60), st.floats(1e-5, 1.0), st.floats(-100, 100))
def test_any_text_and_number_survive_the_recording(
    shows: str, radius_m: float, kappa: float
) -> None:
    default = load(DEFAULT)
    scene = default.model_copy(
        update={
            "shows": shows,
            "sphere": default.sphere.model_copy(update={"radius_m": radius_m}),
            "controller": default.controller.model_copy(update={"kappa": kappa}),
        }
    )
    assert parse(to_toml(scene)) == scene


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("sphere.radius_m=-1", ("sphere.radius_m = -1", "must be at least 1e-05")),
        ("sphere.radius_m=3 mm", ("sphere.radius_m = '3 mm'", "number")),
        ("plate.size_m=0.5", ("plate.size_m = 0.5",)),
        ("plate.contact_point_m=[0.5, 0.25]", ("lies outside the plate", "[0.5, 0.25]")),
        ("plate.actuator_point_m=[-0.1, 0.25]", ("plate.actuator_point_m", "outside")),
        ("sensors.quantity=v_p", ("sensors.quantity = 'v_p'", "controller.law")),
        ("sensors.full_scale=[1.0, -1.0]", ("sensors.full_scale", "lower")),
        ("controller.law=pid", ("controller.law = 'pid'", "slope_threshold")),
        ("controller.law=profile", ("controller.profile_n is empty",)),
        ("controller.law=constant", ("controller.duration_us = 0",)),
        ("controller.latency_us=1.5", ("controller.latency_us = 1.5", "multiple of 1 us")),
        ("controller.bits=8", ("controller.full_scale_n",)),
        ("controller.kapa=1", ("controller.kapa: unknown scene key", "Did you mean kappa?")),
        ("contoller.kappa=1", ("contoller", "controller")),
        ("run.duration_s=1e-10", ("run.duration_s", "0 steps")),
        ("run.duration_s=1e9", ("run.duration_s", "steps")),
        ("name=../../etc/passwd", ("name",)),
        ("kappa", ("invalid setting", "table.key=value")),
        ("sphere.radius_m.x=3", ("sphere.radius_m.x", "is a value, not a table")),
    ],
)
def test_refused_with_a_sentence(setting: str, words: tuple[str, ...]) -> None:
    with pytest.raises(SceneError) as caught:
        build_plant(resolve(load(DEFAULT, [setting])))
    for word in words:
        assert word in str(caught.value), str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["controller.law=off", "controller.kappa=3"], "law = 'off', whose keys are: none."),
        (
            ["controller.lead_us=3", "controller.law=predicted"],
            "are: kappa, v_thr_m_s, window",
        ),
        (["contact.restitution=0.5"], "with contact.damping = 'none'. Leave the key out"),
        (["actuator.damping=0.3", "actuator.mass_kg=0.01"], "without actuator.bandwidth_hz. Leave"),
    ],
)
def test_a_key_without_effect_is_refused(settings: list[str], words: str) -> None:
    with pytest.raises(SceneError, match=rf"has no effect .*{re.escape(words)}"):
        load(DEFAULT, settings)
    values = dict(setting.split("=") for setting in settings)
    with pytest.raises(SceneError, match=r"has no effect|controller\.law"):
        vary(load(DEFAULT), {key: toml_value(value) for key, value in values.items()})


def test_a_key_of_another_law_may_have_its_default() -> None:
    off = load(DEFAULT, ["controller.law=off"])
    assert load(DEFAULT, ["controller.law=off", "controller.kappa=0.8"]) == off
    assert load(DEFAULT, ["actuator.damping=0.7", "contact.restitution=1"]) == load(DEFAULT)


def test_a_setting_drops_keys_of_the_file_that_lose_their_effect(tmp_path: Path) -> None:
    """One setting switches the law or the damper of a file; what it says itself is refused."""
    for scene in (
        load("offcentre-6mm", ["controller.law=off"]),
        vary(load("offcentre-6mm"), {"controller.law": "off"}),
        load("offcentre-6mm").without_control(),
    ):
        assert not hasattr(scene.controller, "kappa")
        assert parse(to_toml(scene)) == scene
    assert load("offcentre-6mm", ["controller.law=force_feedback"]).controller.kappa == 0.4
    for scene in (
        load("oak-20mm", ["contact.damping=none"]),
        vary(load("oak-20mm"), {"contact.damping": "none"}),
    ):
        assert scene.contact.restitution == 1.0
        assert parse(to_toml(scene)) == scene
    file = tmp_path / "mine.toml"
    text = to_toml(load("offcentre-6mm"))
    file.write_text(text.replace('law = "slope_threshold"', 'law = "off"'))
    with pytest.raises(SceneError, match=r"controller\.kappa = 0\.4: has no effect"):
        load(str(file))


def test_a_recording_may_have_keys_without_effect() -> None:
    text = to_toml(load("offcentre-6mm")).replace('law = "slope_threshold"', 'law = "off"')
    assert parse(text, recorded=True) == load("offcentre-6mm", ["controller.law=off"])


@pytest.mark.parametrize(
    ("scene", "settings", "words"),
    [
        ("offcentre-6mm", [], "plate.actuator_point_m = [0.155, 0.09]"),
        ("thesis-oak", ["contact.damping=none"], "Use the scheme 'modal'"),
        ("aluminium-3mm", ["contact.damping=relaxation"], "relaxation"),
    ],
)
def test_what_an_infinite_plate_does_not_know(scene: str, settings: list[str], words: str) -> None:
    with pytest.raises(SceneError) as caught:
        load(scene, [*settings, "run.plate_model=infinite"])
    assert words in str(caught.value)


def test_auto_takes_an_infinite_plate_until_reflections_matter() -> None:
    def model(name: str, *settings: str) -> str:
        return resolve(load(name, settings)).plate_model

    until = "run.duration_s=0.00114"  # 140 us after the first touch
    assert model("aluminium-3mm", until) == "infinite"
    scene = load("aluminium-3mm", [until])
    assert resolve(scene).plant.infinite_plate
    assert model_error.expected_error(resolve(scene)) <= scene.run.accuracy
    assert scene.step_s < model_error.infinite_plate_lasts_s(resolve(scene)) - 140e-6 < 100e-6
    for changed in (
        "run.duration_s=0.0012", "run.duration_s=0.00101", "run.duration_s=0.0009",
        "run.accuracy=1e-5", "run.plate_model=modal",
        "plate.contact_point_m=[0.1, 0.25]", "plate.actuator_point_m=[0.2, 0.25]",
        "controller.kappa=1.5", "controller.drop_out_probability=0.1",
    ):  # fmt: skip
        assert model("aluminium-3mm", until, changed) == "modal", changed
    assert model("aluminium-3mm", "run.duration_s=0.0012", "run.plate_model=infinite") == "infinite"
    # Where the contact lasts until reflections are back it is never taken.
    assert model_error.infinite_plate_lasts_s(resolve(load("aluminium-20mm"))) == 0.0
    # Whole runs keep the modes.
    assert {model(name) for name in shipped()} == {"modal"}


def test_an_infinite_plate_may_be_of_any_size() -> None:
    huge = ["plate.size_m=[20.0, 20.0]", "plate.contact_point_m=[9.0, 9.0]"]
    short = ["run.duration_s=0.00114", "run.plate_model=infinite"]
    scene = load("aluminium-3mm", [*huge, *short])
    assert resolve(scene).plant.infinite_plate
    found = metrics_of(resolve(scene), simulate(resolve(scene)).truth)
    usual = load("aluminium-3mm", short)
    expected = metrics_of(resolve(usual), simulate(resolve(usual)).truth)
    assert found.impacts == expected.impacts
    case = metrics_of_case(resolve(scene), "run")
    assert expected.whole_run is not None
    assert case.plate_energy_j == expected.whole_run.plate_energy_j
    # Without plate_model it is found to do, and what needs the modes says so.
    assert resolve(load("aluminium-3mm", [*huge, short[0]])).plant.infinite_plate
    with pytest.raises(SceneError, match=r"--verify needs about 2.1e\+07 modes"):
        check_verifiable(resolve(scene))


@pytest.mark.parametrize(
    ("text", "words"),
    [("name = ", "not valid TOML"), ("", "is missing"), ("\x00", "not valid TOML")],
)
def test_broken_scene_text(text: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        parse(text)


def test_unknown_scene_and_file(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="Did you mean aluminium-3mm"):
        load("aluminum-3mm")
    with pytest.raises(SceneError, match="cannot read the scene"):
        load(str(tmp_path / "none.toml"))
    (tmp_path / "latin.toml").write_bytes(b"name = \xff\xfe")
    with pytest.raises(SceneError, match="cannot read the scene"):
        load(str(tmp_path / "latin.toml"))


def test_accuracy_decides_how_many_modes() -> None:
    """And the most that a step can carry is the end of it (pi/dt)."""
    counts = []
    for accuracy in (0.1, 0.03, 0.01, 1e-3):
        scene = load("aluminium-20mm", [f"run.accuracy={accuracy}"])
        spec = resolve(scene).plant
        nyquist = 0.5 / spec.step_s
        assert spec.frequency_limit_hz <= nyquist
        expected = model_error.expected_error(resolve(scene))
        assert math.isclose(expected, accuracy) or spec.frequency_limit_hz == nyquist
        counts.append(spec.frequency_limit_hz)
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]
