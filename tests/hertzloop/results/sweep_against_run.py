"""Compare the first impact of a sweep's case with that of a run, on scenes drawn over all keys.

A case ends as soon as nothing later can belong to its first impact; a run goes on. Both have the
same samples and states for as long as the case lasts, bit by bit, and the same metrics.

    python -m tests.hertzloop.results.sweep_against_run --draws 2000 --seed 1

prints each scene that differs, with the fewest keys that make it differ, and how many scenes were
alike.
"""

import argparse
import json
import random
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hertzloop.controller.loading.registry import shipped
from hertzloop.loop.simulate import LawStopped, simulate
from hertzloop.results.impact_windows import ImpactMetrics
from hertzloop.results.impacts import first_impact, impacts_of_blocks
from hertzloop.results.span_metrics import of_impact
from hertzloop.results.spans import follow
from hertzloop.scene.controller import build_controller
from hertzloop.scene.errors import SceneError
from hertzloop.scene.scene import Scene
from hertzloop.scene.setup import Setup, load

Keys = dict[str, Any]
Values = dict[str, list[Any]]

SCENES = {"aluminium-3mm": 4, "aluminium-20mm": 1, "offcentre-6mm": 1, "oak-20mm": 1}


@dataclass(frozen=True)
class Group:
    """Keys that go together: all of `needed`, and each of `may` in half of the scenes. A key that
    no table has any more is left out; without one of `needed` the group is."""

    probability: float
    needed: Values
    may: Values


def _group(probability: float, needed: Values, **may: list[Any]) -> Group:
    return Group(probability, needed, {key.replace("__", "."): v for key, v in may.items()})


_SIZES = [-1e-3, -1e-4, -1e-5, 1e-6, 1e-5, 1e-4]
_STARTS_S = [0.0, 6e-4, 9e-4, 1.005e-3, 1.03e-3, 1.1e-3, 1.4e-3]
_LASTS_S = [1e-5, 1e-4, 5e-4]
_OFTEN = [0.001, 0.01, 0.1, 0.5]
_TRACE = [float(7 * i % 60) for i in range(20)]
GROUPS = [
    _group(1.0, {"run.duration_s": [0.0015, 0.003, 0.006, 0.012], "run.seed": list(range(1000))}),
    _group(0.7, {"run.touch_phase": [0.1, 0.0, 0.99, "random"]}),
    _group(0.15, {"run.lead_in_s": [0.0002, 0.002]}),
    _group(0.1, {"run.step_ns": [500, 2000]}),
    _group(0.1, {"run.accuracy": [0.0005, 0.05]}),
    _group(0.3, {"sensors.every_steps": [2, 3, 5, 10]}),
    _group(0.3, {"sensors.bits": [6, 8, 10, 12, 16]}, sensors__full_scale=["contact", "auto"]),
    _group(0.1, {"sensors.full_scale": [[-1e-4, 1e-3], [-1e-6, 1e-5], "none"]}),
    _group(
        0.3,
        {"sensors.low_pass_hz": [3e3, 2e4, 1e5, 3e5]},
        sensors__low_pass_order=[2, 3, 4, 8],
        sensors__low_pass=["butterworth", "bessel"],
    ),
    _group(0.2, {"sensors.ac_coupling_hz": [1.0, 30.0, 500.0, 5e3]}),
    _group(
        0.2, {"sensors.resonance_hz": [2e3, 1e4, 5e4]}, sensors__resonance_damping=[0.02, 0.2, 0.7]
    ),
    _group(0.2, {"sensors.noise_rms": [1e-9, 1e-7, 1e-6, 1e-5]}),
    *(
        _group(
            0.08,
            {"sensors.fault": [fault]} | needed,
            sensors__fault_start_s=_STARTS_S,
            **({} if fault == "spikes" else {"sensors__fault_duration_s": _LASTS_S}),
        )
        for fault, needed in {
            "stuck": {},
            "offset": {"sensors.fault_size": _SIZES},
            "spikes": {"sensors.fault_size": _SIZES, "sensors.fault_probability": _OFTEN},
            "drop_outs": {"sensors.fault_probability": _OFTEN},
            "saturation": {"sensors.fault_size": [1e-6, 1e-5, 1e-4]},
        }.items()
    ),
    _group(0.4, {"controller.latency_us": [1.0, 3.0, 10.0, 50.0, 200.0]}),
    _group(0.2, {"controller.jitter_us": [1.0, 5.0, 30.0, 150.0]}),
    _group(
        0.08,
        {"controller.latency_trace": [_TRACE]},
        controller__latency_trace_use=["replay", "resample"],
    ),
    _group(0.15, {"controller.clock_ppm": [50.0, -200.0, 20000.0]}),
    _group(0.15, {"controller.clock_phase": [0.3, 0.9]}),
    _group(0.2, {"controller.drop_out_probability": [0.01, 0.2, 0.7, 0.95]}),
    _group(0.2, {"controller.bits": [4, 8, 12], "controller.full_scale_n": [10.0, 100.0, 1000.0]}),
    _group(0.2, {"controller.slew_n_s": [1e4, 1e6, 1e7, 1e8]}),
    _group(0.2, {"actuator.dead_time_us": [2.0, 20.0, 120.0, 400.0]}),
    _group(0.15, {"actuator.stuck_from_s": [0.0, 9e-4, 1.01e-3, 1.03e-3, 1.3e-3]}),
    _group(0.15, {"sphere.drop_height_m": [1e-5, 1e-3, 0.5]}),
    _group(0.05, {"sphere.speed_m_s": [0.1, 2.0]}),
    _group(0.05, {"sphere.material": ["glass", "aluminium"]}),
    _group(0.05, {"sphere.radius_m": [0.002, 0.005]}),
    _group(0.05, {"sphere.mass_kg": [5e-4, 2e-3]}),
    _group(0.05, {"plate.loss_factor": [0.0, 0.02]}),
    _group(0.05, {"contact.stiffness_factor": [0.5, 2.0]}),
]

# Keys that change what is compiled, by the kind of plant that they make. A scene has one kind.
KINDS: dict[str, Values] = {
    "plain": {},
    "modal": {"run.plate_model": ["modal"]},
    "yield": {"contact.plasticity": ["thornton"], "contact.limiting_pressure_pa": [1e9, 3e8]},
    "slow actuator": {
        "actuator.bandwidth_hz": [2e3, 2e4, 2e5],
        "actuator.damping": [0.1, 0.7, 2.0],
    },
    "hunt-crossley": {
        "contact.damping": ["hunt_crossley"],
        "contact.restitution": [0.3, 0.6, 0.9],
    },
    "infinite": {"run.plate_model": ["infinite"]},
    "dashpot": {"contact.damping": ["viscous"], "contact.viscous_n_s_m": [0.1, 10.0]},
    "force limit": {"actuator.force_limit_n": [1.0, 30.0]},
    "slow limited actuator": {
        "actuator.bandwidth_hz": [2e4],
        "actuator.force_limit_n": [1.0, 30.0],
    },
    "actuator mass": {"actuator.mass_kg": [0.001, 0.02]},
    "actuator elsewhere": {"plate.actuator_point_m": [[0.15, 0.1], [0.2, 0.12]]},
    "sensor elsewhere": {
        "sensors.point_m": [[0.15, 0.1], [0.2, 0.12]],
        "controller.law": ["velocity_feedback", "acceleration_feedback"],
    },
    "other plate": {
        "plate.material": ["steel", "glass"],
        "plate.size_m": [[0.4, 0.3]],
        "plate.thickness_m": [0.004],
        "plate.contact_point_m": [[0.17, 0.14]],
    },
    "clamped": {"plate.edges": ["cccc", "cfcf"], "run.accuracy": [0.05]},
    "damped tail": {"plate.tail": ["damped"], "run.plate_model": ["modal"]},
    "spring tail": {"plate.tail": ["spring"], "run.plate_model": ["modal"]},
}
# Kinds whose kernels most tests need, so that the default tier compiles none for these draws.
QUICK_KINDS = ("plain", "modal", "yield", "slow actuator", "hunt-crossley")

_THRESHOLD = {"controller.v_thr_m_s": [-1.0, -0.6, -0.25, -0.05, 0.0]}
_KAPPA = {"controller.kappa": [0.1, 0.5, 0.8, 1.2, -0.5]}
# How often each law is drawn, the keys that it needs, and those that it may have.
LAWS: dict[str, tuple[int, Values, Values]] = {
    "off": (1, {}, {}),
    "slope_threshold": (5, {}, _THRESHOLD | _KAPPA | {"controller.lead_us": [0.0, 5.0]}),
    "least_squares": (1, {}, _THRESHOLD | _KAPPA),
    "shifted_threshold": (1, {}, _THRESHOLD | _KAPPA),
    "predicted": (1, {}, _THRESHOLD | _KAPPA),
    "fade_out": (1, {}, _THRESHOLD | _KAPPA),
    "dent_threshold": (1, {}, _THRESHOLD),
    "force_feedback": (1, {}, _KAPPA),
    "velocity_feedback": (1, {}, _KAPPA),
    "acceleration_feedback": (1, {}, _KAPPA),
    "constant": (
        2,
        {
            "controller.force_n": [1.0, 20.0, -20.0],
            "controller.duration_us": [5.0, 50.0, 400.0, 3000.0],
            "controller.delay_us": [0.0, 10.0, 150.0, 700.0],
        },
        {},
    ),
    "profile": (
        1,
        {
            "controller.profile_n": [
                [float(v) for v in np.random.default_rng(n).choice([0, 0, 5, -5, 20], n)]
                for n in (5, 50, 400)
            ]
        },
        {},
    ),
    "precomputed": (1, {"controller.precomputed": ["F_a7", "F_a1"]}, {}),
    "linear": (
        2,
        {
            "controller.numerator": [[1.0, 0.0], [1.0, -0.9]],
            "controller.denominator": [[1.0, 0.0], [1.0, -0.5], [1.0, -0.95], [1.0, -0.999]],
            "sensors.quantity": ["v_p", "xi", "contact_force", "acceleration"],
        },
        {},
    ),
}
_GAINS = {"v_p": -10.0, "xi": -1e4, "contact_force": 0.3, "acceleration": -1e-3}
# Keys that no scene here has, and why: what they name is a file, or the result of another program.
LEFT_OUT = {
    "plate.modes",  # a file of modes
    "plate.residual_flexibility_m_n",  # of such a file
    "controller.law_digest",  # refuses a law, and changes nothing
    "controller.latency_trace_from",  # of a trace that a recording gives
    "contact.relaxation_stiffness",  # of the published scheme, which has no case
    "contact.relaxation_s",
    "contact.relaxation_solve",
    "plate.theory",  # "kirchhoff" alone, or a structure that a program adds
    "run.scheme",  # a case needs one that conserves energy
}


def keys_of_tables() -> set[str]:
    """All keys of a scene's tables but those of a fit, which a run does not read."""
    found = set()
    for name, field in Scene.model_fields.items():
        for kind in getattr(field.annotation, "__args__", (field.annotation,)):
            found |= {f"{name}.{key}" for key in getattr(kind, "model_fields", ())}
    return {key for key in found if not key.startswith("fit.")}


def keys_drawn() -> set[str]:
    """All keys of a scene's tables that a draw may set, and those that it always has."""
    drawn = {"controller.law"}
    for group in GROUPS:
        drawn |= {*group.needed, *group.may}
    for values in (*KINDS.values(), *(row[1] for row in LAWS.values())):
        drawn |= set(values)
    return drawn


def draw(seed: int, number: int, kinds: tuple[str, ...] = tuple(KINDS)) -> tuple[str, Keys]:
    """Draw `number` of a seed: the name of a scene, and values of its keys."""
    rng, known = random.Random(f"{seed} {number}"), keys_of_tables()
    scene = rng.choices(list(SCENES), list(SCENES.values()))[0]
    kind = KINDS[kinds[number % len(kinds)]]
    laws = [name for name in kind.get("controller.law", LAWS) if name in shipped()]
    law = rng.choices(laws, [LAWS[name][0] for name in laws])[0]
    keys: Keys = {"controller.law": law}
    _, needed, may = LAWS[law]
    keys |= _chosen(rng, needed) | _chosen(rng, may, 0.5)
    if law == "linear":
        gain = _GAINS[keys["sensors.quantity"]]
        keys["controller.numerator"] = [gain * value for value in keys["controller.numerator"]]
    for group in GROUPS:
        if rng.random() < group.probability and known >= set(group.needed):
            keys |= _chosen(rng, group.needed)
            keys |= _chosen(rng, {k: v for k, v in group.may.items() if k in known}, 0.5)
    if known >= set(kind):
        keys |= _chosen(rng, {key: v for key, v in kind.items() if key != "controller.law"})
    return scene, keys


def _chosen(rng: random.Random, values: Values, probability: float = 1.0) -> Keys:
    return {key: rng.choice(v) for key, v in values.items() if rng.random() < probability}


def resolved(scene: str, keys: Mapping[str, Any]) -> Setup | None:
    """The setup of a draw; None where these keys do not go together."""
    try:
        setup = load(scene).vary(keys)
        build_controller(setup, ahead=True, steps=1)
    except (SceneError, ValueError):
        return None
    return setup


def difference(setup: Setup) -> str:
    """What differs between the first impact of a case and that of a run; "" if nothing does."""
    try:
        setup, case = follow(setup, "impact")
    except LawStopped as error:
        return _stopped_as(setup, str(error))
    try:
        run = simulate(setup)
    except LawStopped as error:  # after the impact
        truth, values = error.truth, None
    else:
        truth, values = run.truth, run.values
    ran, taken = case.truth.shape[1], len(case.values)
    if not _alike(case.truth, truth[:, :ran]):
        return f"the states of {ran} steps"
    if values is not None and not _alike(case.values, values[:taken]):
        return f"the samples of {ran} steps"
    # As a report of the run has it, and as it is found in all steps.
    in_run = next(impacts_of_blocks(setup, [(0, truth)]), None), first_impact(setup, truth)
    first = first_impact(setup, case.truth)
    wrong = "; ".join(filter(None, (_wrong(first, expected) for expected in in_run)))
    return f"{wrong}; {ran} steps were run" if wrong else ""


def _wrong(first: ImpactMetrics | None, expected: ImpactMetrics | None) -> str:
    """What differs between an impact and the expected one."""
    if first is None or expected is None:
        return "" if first is expected else f"impact {first}, expected {expected}"
    if (first.start, first.end, first.over) != (expected.start, expected.end, expected.over):
        return f"end at step {first.over}, expected {expected.over}"
    found, wanted = vars(of_impact(first)), vars(of_impact(expected))
    wrong = [name for name, value in wanted.items() if not _alike(found[name], value)]
    return ", ".join(f"{name} {found[name]}, expected {wanted[name]}" for name in wrong)


def _stopped_as(setup: Setup, message: str) -> str:
    try:
        simulate(setup)
    except LawStopped:
        return ""  # both stop; which model of the plate is tried first may decide at which step
    return f"the case stops: {message}"


def _alike(a: Any, b: Any) -> bool:
    return np.asarray(a, float).tobytes() == np.asarray(b, float).tobytes()


def fewest_keys(scene: str, keys: Keys) -> Keys:
    """The keys of a draw without those that it differs without."""
    keys, before = dict(keys), None
    while before != keys:
        before = dict(keys)
        for key in before:
            fewer = {name: value for name, value in keys.items() if name != key}
            setup = resolved(scene, fewer)
            if setup is not None and difference(setup):
                keys = fewer
    return keys


def differences(
    seed: int, draws: int, kinds: tuple[str, ...] = tuple(KINDS)
) -> Iterator[tuple[str, str, Keys, str]]:
    """Yield for each of so many scenes that can be run its kind, its name, its keys, and what
    differs."""
    done, number = 0, -1
    while done < draws:
        number += 1
        scene, keys = draw(seed, number, kinds)
        setup = resolved(scene, keys)
        if setup is not None:
            done += 1
            yield kinds[number % len(kinds)], scene, keys, difference(setup)


def main() -> int:
    """Run the comparison; returns 1 if a scene differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draws", type=int, default=2000, help="number of scenes")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draws")
    asked = parser.parse_args()
    started, tally, wrong = time.monotonic(), Counter[str](), 0
    for kind, scene, keys, what in differences(asked.seed, asked.draws):
        tally[kind] += 1
        if what:
            wrong += 1
            print(f"DIFFERS {scene}: {what}\n  {json.dumps(fewest_keys(scene, keys))}", flush=True)
    print(", ".join(f"{kind} {count}" for kind, count in tally.most_common()))
    lasted = time.monotonic() - started
    print(f"seed {asked.seed}: {asked.draws} scenes, {wrong} differ, {lasted:.0f} s")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
