"""A sweep's case sees the first impact that a run sees, whatever keys a scene has."""

from typing import Any

import pytest

from hertzloop.controller.loading.registry import shipped
from tests.hertzloop.results import sweep_against_run as against

# Scenes whose cases ended too early, or whose metrics differed.
_SHORT = {"run.duration_s": 0.003}
ENDED_EARLY: list[tuple[str, dict[str, Any]]] = [
    ("oak-20mm", {"sensors.ac_coupling_hz": 5000.0, "run.duration_s": 0.02}),
    (
        "aluminium-3mm",
        {
            **_SHORT,
            "sensors.fault": "offset",
            "sensors.fault_start_s": 0.0014,
            "sensors.fault_size": -1e-3,
        },
    ),
    (
        "offcentre-6mm",
        {
            "sensors.bits": 16,
            "sensors.low_pass_hz": 3000.0,
            "sensors.low_pass_order": 4,
            "controller.law": "constant",
            "controller.force_n": -20.0,
            "controller.duration_us": 5.0,
            "run.accuracy": 0.01,
            "run.duration_s": 0.006,
        },
    ),
    (
        "aluminium-3mm",
        {
            **_SHORT,
            "sensors.fault": "spikes",
            "sensors.fault_size": -1e-3,
            "sensors.fault_probability": 0.001,
        },
    ),
    ("aluminium-3mm", {**_SHORT, "sensors.resonance_hz": 2000.0}),
    # The actuator pushes until the next contact.
    (
        "offcentre-6mm",
        {
            "sensors.fault": "saturation",
            "sensors.fault_size": 1e-6,
            "sphere.drop_height_m": 1e-5,
            "actuator.bandwidth_hz": 2000.0,
        },
    ),
]


@pytest.mark.parametrize(("scene", "keys"), ENDED_EARLY)
def test_a_case_lasts_as_long_as_the_sensor_can_show_a_contact(scene, keys):
    setup = against.resolved(scene, keys)
    assert setup is not None
    assert against.difference(setup) == ""


def test_a_hundred_drawn_scenes_have_the_same_first_impact_in_a_sweep_and_in_a_run():
    drawn = list(against.differences(seed=1, draws=100, kinds=against.QUICK_KINDS))
    assert [row for row in drawn if row[-1]] == []


def test_a_scene_that_differs_is_found(monkeypatch):
    """The comparison fails where an option of the sensor is forgotten."""
    monkeypatch.setattr("hertzloop.sensors.acquisition.LeastSample.of", _forgetful)
    setup = against.resolved(*ENDED_EARLY[0])
    assert setup is not None
    assert against.difference(setup).startswith("end at step")


def _forgetful(spec: Any) -> Any:
    from hertzloop.sensors.acquisition import LeastSample

    return LeastSample(1.0, 0.0, 0.0, 0, 0)


def test_every_key_and_every_law_is_drawn():
    """A new key, or a new law, fails here until draws have it."""
    assert against.keys_of_tables() <= against.keys_drawn() | against.LEFT_OUT
    assert set(shipped()) <= set(against.LAWS)
