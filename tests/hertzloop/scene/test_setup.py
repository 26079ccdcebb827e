"""A varied setup is the setup that is resolved anew, for every key of every shipped scene."""

import sys
from dataclasses import fields
from typing import Any

import pytest

from hertzloop.scene import keys
from hertzloop.scene.controller import law_context, loaded_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.mechanics import Mechanics
from hertzloop.scene.setup import Setup, load
from hertzloop.scene.toml import toml_text
from tests.hertzloop.scenes import aluminium_3mm
from tests.tiers import default

SCENES = ["aluminium-20mm", "oak-20mm"]
STAGES = (
    "run", "mechanics", "plant", "sensor", "signal_path", "law_context", "first_touch_s",
    "plate_model", "latency_us",
)  # fmt: skip
FOLLOWING = {
    "infinite_plate_lasts_s": lambda setup: setup.infinite_plate.lasts_s(),
    "phase": lambda setup: setup.run.phase,
    "force_bound": lambda setup: setup.infinite_plate.force_bound,
    "expected_error": lambda setup: setup.expected_error,
    "about": law_context,
}
# Values to try of keys that are not plain numbers, beside those that a key's kind names.
TRIED: dict[str, list[Any]] = {
    "sphere.material": ["aluminium"],
    "plate.material": ["steel"],
    "plate.material.young_pa": [6.1e10],
    "plate.size_m": [[0.31, 0.37]],
    "plate.contact_point_m": [[0.11, 0.13]],
    "plate.actuator_point_m": [[0.1, 0.12]],
    "plate.edges": ["cccc"],
    "plate.loss_factor": [0.07],
    "sensors.full_scale": ["contact", "none", [-2e-5, 3e-5]],
    "sensors.quantity": ["v_p"],
    "sensors.point_m": [[0.12, 0.14]],
    "sensors.bits": [11],
    "sensors.low_pass_hz": [9e4],
    "sensors.low_pass_order": [4],
    "controller.law": ["force_feedback", "precomputed", "off"],
    "controller.bits": [9],
    "controller.full_scale_n": [77.0],
    "controller.clock_ppm": [50.0],
    "controller.clock_phase": [0.6],
    "controller.slew_n_s": [1e7],
    "actuator.bandwidth_hz": [3e4],
    "actuator.mass_kg": [1e-3],
    "actuator.force_limit_n": [20.0],
    "contact.restitution": [0.8],
    "contact.limiting_pressure_pa": [2e8],
    "run.touch_phase": [0.3, "random"],
}
# What a key needs beside itself to have an effect, or to be accepted.
WITH: dict[str, dict[str, Any]] = {
    "contact.restitution": {"contact.damping": "hunt_crossley"},
    "contact.viscous_n_s_m": {"contact.damping": "viscous"},
    "contact.relaxation_stiffness": {"contact.damping": "relaxation"},
    "contact.relaxation_s": {"contact.damping": "relaxation"},
    "contact.relaxation_solve": {"contact.damping": "relaxation"},
    "contact.limiting_pressure_pa": {"contact.plasticity": "thornton"},
    "contact.plasticity": {"contact.limiting_pressure_pa": 1e9},
    "actuator.damping": {"actuator.bandwidth_hz": 5e4},
    "controller.bits": {"controller.full_scale_n": 50.0},
    "sensors.point_m": {"sensors.quantity": "v_p"},
    "sensors.low_pass": {"sensors.low_pass_hz": 9e4, "sensors.low_pass_order": 4},
    "sensors.low_pass_order": {"sensors.low_pass_hz": 9e4},
}
NOT_TRIED = {
    "name",
    "shows",
    "materials",
    "controller.law_digest",
    "plate.residual_flexibility_m_n",
    "plate.modes",
}


def values_of(key: keys.Key, now: Any) -> list[Any]:
    """Other values of a key."""
    if key.name in TRIED:
        return TRIED[key.name]
    if '"' in key.possible:
        named = [word.strip().strip('"') for word in key.possible.replace(" or ", ",").split(",")]
        return [word for word in named if word != now and word.isidentifier()]
    if isinstance(now, bool) or now is None or isinstance(now, list | tuple | str):
        return [1.0] if "number" in key.possible or " to " in key.possible else []
    if "whole" in key.possible:
        return [now + 1]
    return [now * 1.01 if now else 1e-3, 1.0]


def forget() -> None:
    """Drop the results that all stages have kept."""
    for name, module in list(sys.modules.items()):
        if name.startswith("hertzloop.scene"):
            for one in vars(module).values():
                if hasattr(one, "cache_clear"):
                    one.cache_clear()


def stages(setup: Setup) -> dict[str, Any]:
    """What all stages come to: a value, or the sentence that refuses it."""
    found: dict[str, Any] = {}
    for stage in (*STAGES, *FOLLOWING):
        try:
            value = FOLLOWING[stage](setup) if stage in FOLLOWING else getattr(setup, stage)
        except SceneError as error:
            value = str(error)
        if isinstance(value, Mechanics):  # modes of a file are compared as what they are read from
            value = {part.name: getattr(value, part.name) for part in fields(value)}
        found[stage] = value
    try:
        constants = loaded_law(setup).constants(setup.scene.controller.keys, law_context(setup))
        found["constants"] = repr(
            [getattr(part, "tolist", lambda p=part: p)() for part in constants]
        )
    except (SceneError, ValueError) as error:
        found["constants"] = str(error)
    return found


@pytest.mark.parametrize("name", default(SCENES, ["aluminium-20mm"]))
def test_every_key_varied_gives_what_is_resolved_anew(name):
    base, tried, accepted = load(name), set(), set()
    known = keys.keys()
    for key in known:
        if key.name in NOT_TRIED:
            continue
        tried.add(key.name)
        now: Any = base.scene.model_dump()
        for part in key.name.split("."):
            now = now.get(part) if isinstance(now, dict) else None
        for value in values_of(key, now):
            changed = {**WITH.get(key.name, {}), key.name: value}
            try:
                varied = base.vary(changed)
            except SceneError:
                continue
            accepted.add(key.name)
            # Stages that are kept are those of the unchanged setup, and of others before.
            stages(base)
            found = stages(varied)
            forget()
            fresh = load(name, [f"{k}={toml_text(v)}" for k, v in changed.items()])
            assert found == stages(fresh), (key.name, value)
            forget()
    assert len(accepted) > 0.45 * len(tried), sorted(accepted)


def test_a_law_works_with_the_stiffness_that_the_plant_announced():
    setup = aluminium_3mm()
    told = setup.with_stiffness(2.0 * setup.law_context.stiffness)
    assert law_context(told).stiffness == 2.0 * law_context(setup).stiffness
    assert law_context(told).rigid_peak_n != law_context(setup).rigid_peak_n
    assert told.plant is setup.plant
