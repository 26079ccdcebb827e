"""Scenes: what is accepted, and the sentences for what is not."""

import math
import re

import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.results.cases import metrics_of_case
from hertzloop.results.metrics import metrics_of
from hertzloop.results.verification import check_verifiable
from hertzloop.scene.build import build_plant
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT, load, parse, shipped
from hertzloop.scene.setup import resolve
from hertzloop.scene.toml import to_toml, toml_value
from hertzloop.scene.varying import vary
from tests.hertzloop.scenes import aluminium_3mm


def test_the_scenes_that_come_with_it():
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
def test_what_is_recorded_is_the_same_scene(name):
    settings = [
        "sensors.noise_rms=1.25e-7",
        "controller.bits=12",
        "run.seed=77",
        "controller.full_scale_n=100",
        "controller.law=profile",
        "controller.profile_n=[1.5, -2.0]",
    ]
    scene = load(name, settings)
    assert scene.controller.profile_n == (1.5, -2.0)
    assert parse(to_toml(scene)) == scene


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["controller.law=off", "controller.kappa=3"], "law = 'off', whose keys are: none."),
        (
            ["controller.lead_us=3", "controller.law=predicted"],
            "are: kappa, v_thr_m_s, window",
        ),
        (["contact.restitution=0.5"], "without contact.damping = 'hunt_crossley'. Leave"),
        (["actuator.damping=0.3", "actuator.mass_kg=0.01"], "without actuator.bandwidth_hz. Leave"),
    ],
)
def test_a_key_without_effect_is_refused(settings, words):
    with pytest.raises(SceneError, match=rf"has no effect .*{re.escape(words)}"):
        load(DEFAULT, settings)
    values = dict(setting.split("=") for setting in settings)
    with pytest.raises(SceneError, match=r"has no effect|controller\.law"):
        vary(load(DEFAULT), {key: toml_value(value) for key, value in values.items()})


def test_a_key_of_another_law_may_have_its_default():
    off = load(DEFAULT, ["controller.law=off"])
    assert load(DEFAULT, ["controller.law=off", "controller.kappa=0.8"]) == off
    assert load(DEFAULT, ["actuator.damping=0.7", "contact.restitution=1"]) == load(DEFAULT)


def test_a_setting_drops_keys_of_the_file_that_lose_their_effect(tmp_path):
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


def test_a_recording_may_have_keys_without_effect():
    text = to_toml(load("offcentre-6mm")).replace('law = "slope_threshold"', 'law = "off"')
    assert parse(text, recorded=True) == load("offcentre-6mm", ["controller.law=off"])


def test_auto_takes_an_infinite_plate_until_reflections_matter():
    until = "run.duration_s=0.00112"  # 120 us after the first touch
    setup = aluminium_3mm(until)
    assert setup.plate_model == "infinite"
    assert setup.plant.infinite_plate
    assert setup.expected_error <= setup.run.accuracy
    assert setup.run.step_s < setup.infinite_plate.lasts_s() - 120e-6 < 100e-6
    for changed in (
        "run.duration_s=0.0012",
        "run.duration_s=0.00101",
        "run.duration_s=0.0009",
        "run.accuracy=1e-5",
        "run.plate_model=modal",
        "plate.contact_point_m=[0.1, 0.25]",
        "plate.actuator_point_m=[0.2, 0.25]",
        "controller.kappa=1.5",
        "controller.drop_out_probability=0.1",
    ):
        assert aluminium_3mm(until, changed).plate_model == "modal", changed
    asked = aluminium_3mm("run.duration_s=0.0012", "run.plate_model=infinite")
    assert asked.plate_model == "infinite"
    # Where the contact lasts until reflections are back it is never taken.
    assert resolve(load("aluminium-20mm")).infinite_plate.lasts_s() == 0.0
    # Whole runs keep the modes.
    assert {resolve(load(name)).plate_model for name in shipped()} == {"modal"}


def test_an_infinite_plate_may_be_of_any_size():
    huge = ["plate.size_m=[20.0, 20.0]", "plate.contact_point_m=[9.0, 9.0]"]
    short = ["run.duration_s=0.00114", "run.plate_model=infinite"]
    setup, usual = aluminium_3mm(*huge, *short), aluminium_3mm(*short)
    assert setup.plant.infinite_plate
    found, expected = (metrics_of(one, simulate(one).truth) for one in (setup, usual))
    assert found.impacts == expected.impacts
    case = metrics_of_case(setup, "run")
    assert case.plate_energy_j == expected.whole_run.plate_energy_j
    # Without plate_model it is found to do, and what needs the modes says so.
    assert aluminium_3mm(*huge, short[0]).plant.infinite_plate
    with pytest.raises(SceneError, match=r"--verify needs about 2.1e\+07 modes"):
        check_verifiable(setup)


def test_accuracy_decides_how_many_modes():
    """And the most that a step can carry is the end of it (pi/dt)."""
    counts = []
    for accuracy in (0.1, 0.03, 0.01, 1e-3):
        setup = resolve(load("aluminium-20mm", [f"run.accuracy={accuracy}"]))
        spec = setup.plant
        nyquist = 0.5 / spec.step_s
        assert spec.frequency_limit_hz <= nyquist
        expected = setup.expected_error
        assert math.isclose(expected, accuracy) or spec.frequency_limit_hz == nyquist
        counts.append(spec.frequency_limit_hz)
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]
