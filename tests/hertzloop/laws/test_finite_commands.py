"""Every force of a shipped law is a finite number, at every key that a scene accepts."""

from dataclasses import replace
from functools import cache
from typing import Any, Literal, get_args, get_origin

import numpy as np
import pytest
from annotated_types import Ge, Le
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic.fields import FieldInfo

from hertzloop.controller.controller import Controller, SignalPath
from hertzloop.controller.law import WHOLE_STEPS, LawContext
from hertzloop.controller.loading.registry import find, shipped
from hertzloop.loop.answering import answer_samples
from hertzloop.processes.law_trial import impact_samples
from hertzloop.scene.controller import law_context, loaded_law
from hertzloop.scene.setup import Setup, load
from tests.hertzloop.scenes import aluminium_3mm
from tests.tiers import default

LONGER = {"run.duration_s": 2.0}  # than any latency
SCENES = ("aluminium-3mm", "aluminium-20mm", "oak-20mm", "offcentre-6mm")


def values_of(field: FieldInfo) -> st.SearchStrategy[Any]:
    """Values within a key's bounds, the bounds and the default more often."""
    if get_origin(field.annotation) is Literal:
        return st.sampled_from(get_args(field.annotation))
    if get_origin(field.annotation) is tuple:
        forces = st.sampled_from([-1e6, -3.0, 0.0, 5.0, 1e6])
        return st.lists(forces, min_size=1, max_size=6)
    bounds = [info for info in field.metadata if isinstance(info, Ge | Le)]
    low, high = sorted(float(getattr(info, "ge", getattr(info, "le", 0))) for info in bounds)  # type: ignore[arg-type]
    ends = st.sampled_from([low, high, field.default])
    whole = field.annotation is int or WHOLE_STEPS in field.metadata
    if whole:
        return ends.map(int) | st.integers(int(low), 50) | st.integers(int(low), int(high))
    return ends | st.floats(max(low, -2.0), min(high, 2.0)) | st.floats(low, high)


@cache
def known(scene: Setup) -> tuple[float, LawContext]:
    """The contact's stiffness, and what a law may know."""
    stiffness = scene.plant.contact.stiffness
    pulse = np.sin(np.linspace(0.0, np.pi, 40))
    about = replace(law_context(scene), uncontrolled_force_n=lambda: pulse)
    return stiffness, about


def samples_of(scene: Setup, scale: float, noise: float, seed: int) -> np.ndarray:
    """An impact on a rigid plate, made smaller or larger, with noise in shares of the largest."""
    ideal = impact_samples(scene, known(scene)[1])
    random = np.random.default_rng(seed).standard_normal(len(ideal))
    return scale * (ideal + noise * np.abs(ideal).max() * random)


def commands(scene: Setup, samples: np.ndarray) -> np.ndarray:
    """What the scene's law commands after each sample. Raises LawFault."""
    law = loaded_law(scene)
    bound = law.bind(scene.scene.controller.keys, known(scene)[1])
    made = Controller(bound, SignalPath(), scene.run.step_s, len(samples) + 1, 1, 1)
    return answer_samples(made, samples).forces


@pytest.mark.parametrize("law", default(shipped(), ["slope_threshold", "velocity_feedback"]))
def test_every_force_is_a_finite_number(law):
    fields = find(law).keys.model_fields
    if law == "linear":  # an unstable filter has no finite force
        fields = {name: fields[name] for name in ("gain", "numerator")}
    keys = {f"controller.{k}": values_of(f) for k, f in fields.items()}
    if law == "constant":
        keys["controller.duration_us"] = st.integers(1, 10**6)  # it refuses 0
    keys["controller.latency_us"] = st.sampled_from([0, 1, 30, 1000]) | st.integers(0, 10**6)
    keys["sensors.every_steps"] = st.sampled_from([1, 2, 7, 100])

    @settings(max_examples=20, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
    @given(
        name=st.sampled_from(SCENES),
        values=st.fixed_dictionaries(keys),
        scale=st.sampled_from([1.0, -1.0, 0.0, 1e-3, 100.0, 1e6]),
        noise=st.sampled_from([0.0, 1e-3, 1.0]),
        seed=st.integers(0, 9),
    )
    def check(name: str, values: dict[str, Any], scale: float, noise: float, seed: int) -> None:
        scene = load(name).vary({"controller.law": law, **LONGER, **values})
        found = commands(scene, samples_of(scene, scale, noise, seed))
        assert np.isfinite(found).all()

    check()


@pytest.mark.parametrize("name", SCENES)
def test_the_law_that_predicts_does_not_push_where_the_contact_is_long_over(name):
    """In its model the sphere has left after a second, or sticks without a force."""
    longest = {"controller.law": "predicted", "controller.latency_us": 1e6}
    scene = load(name).vary(longest | LONGER)
    assert np.abs(commands(scene, samples_of(scene, 1.0, 0.0, 0))).max() < 1e-100


@pytest.mark.parametrize("law", shipped())
def test_no_law_reads_a_sample_that_it_is_not_given(law):
    own = {
        "constant": ["controller.duration_us=9"],
        "profile": ["controller.profile_n=[1.0]"],
        "linear": ["controller.sections=[[1.0, 0.5, 0.2, 1.0, -0.5, 0.1]]"],
    }
    scene = aluminium_3mm(*own.get(law, []), f"controller.law={law}", "controller.latency_us=10")
    bound = loaded_law(scene).bind(scene.scene.controller.keys, known(scene)[1])
    assert bound.reads_unknown(samples_of(scene, 1.0, 0.0, 0)[:300]) == ""
