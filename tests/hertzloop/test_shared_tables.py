"""What is worked out once for scenes that share tables."""

import pickle

import pytest

from hertzloop import assembly as parts
from hertzloop.scenes.scene import Scene, SceneError, load, to_toml, vary
from hertzloop.scenes.shared import by_tables


def test_a_varied_scene_is_the_one_that_was_read_so() -> None:
    """Tables that a case does not change are taken over as they are; the scene is the same."""
    scene = load("aluminium-3mm", ["sensors.bits=12"])
    for key, value in (
        ("controller.latency_us", 3.0),
        ("controller.law", "force_feedback"),
        ("plate.material.young_pa", 7e10),
        ("sensors.quantity", "auto"),
        ("run.duration_s", 0.002),
    ):
        case = vary(scene, {key: value})
        text = f'"{value}"' if isinstance(value, str) else value
        read = load("aluminium-3mm", ["sensors.bits=12", f"{key}={text}"])
        assert to_toml(case).split("[sphere]")[1] == to_toml(read).split("[sphere]")[1], key
        assert (case.sphere is scene.sphere) is True, key


def test_a_case_that_does_not_fit_is_refused_whatever_table_it_changes() -> None:
    scene = load("aluminium-3mm")
    with pytest.raises(SceneError, match="actuator_point_m"):
        vary(scene, {"plate.actuator_point_m": [9.0, 9.0]})
    with pytest.raises(SceneError, match="latency_us"):
        vary(scene, {"controller.latency_us": 0.5})
    with pytest.raises(SceneError, match="nonsense"):
        vary(scene, {"nonsense.key": 1})


def test_a_result_is_kept_for_scenes_that_share_what_it_reads() -> None:
    asked = []

    @by_tables("plate", "run.step_ns")
    def thickness(scene: Scene) -> float | None:
        asked.append(scene)
        return scene.plate.thickness_m

    scene = load("aluminium-3mm")
    same = vary(scene, {"controller.latency_us": 3.0, "run.duration_s": 0.002})
    other = vary(scene, {"plate.thickness_m": 0.004})
    assert [thickness(s) for s in (scene, same, other)] == [0.003, 0.003, 0.004]
    assert asked == [scene, other]


def test_the_plant_follows_every_table_that_it_is_made_from() -> None:
    scene = load("aluminium-3mm", ["run.plate_model=modal"])
    spec = parts.plant_spec(scene)
    for key, value in (
        ("sphere.radius_m", 0.011), ("plate.thickness_m", 0.004), ("run.accuracy", 2e-3),
        ("contact.damping", "hunt_crossley"), ("actuator.bandwidth_hz", 3e4),
        ("run.lead_in_s", 3e-5), ("run.step_ns", 500), ("run.plate_model", "infinite"),
    ):  # fmt: skip
        changed = {key: value}
        if key == "contact.damping":
            changed["contact.restitution"] = 0.9
        assert parts.plant_spec(vary(scene, changed)) != spec, key


def test_a_copy_of_a_table_is_known_by_what_it_holds() -> None:
    scene = load("aluminium-3mm")
    kept = hash(scene), hash(scene.run)
    other = scene.run.model_copy(update={"seed": 7})
    assert hash(other) != hash(scene.run)
    assert hash(scene.model_copy(update={"run": other})) != hash(scene)
    assert (hash(load("aluminium-3mm")), hash(pickle.loads(pickle.dumps(scene)).run)) == kept
