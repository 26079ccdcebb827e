"""Every force of a shipped law is a finite number, at every key that a scene accepts."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any, Literal, get_args, get_origin

import numpy as np
import pytest
from annotated_types import Ge, Le

from hertzloop.controller.controller import Controller, SignalPath
from hertzloop.controller.law import LawContext
from hertzloop.controller.loading.registry import find, shipped
from hertzloop.loop.answering import answer_samples
from hertzloop.processes.law_trial import impact_samples
from hertzloop.scene.controller import law_context, loaded_law
from hertzloop.scene.setup import Setup, load
from tests.hertzloop.scenes import aluminium_3mm
from tests.tiers import default

LONGER = {"run.duration_s": 2.0}  # than any latency
NEEDED = {
    "constant": {"controller.duration_us": 9},  # it refuses 0
    "linear": {"controller.numerator": [1.0]},
    "profile": {"controller.profile_n": [1.0]},
}
SCENES = ("aluminium-3mm", "aluminium-20mm", "oak-20mm", "offcentre-6mm")


def ends_of(law: str) -> Iterator[dict[str, Any]]:
    """Each key of a law at an end of its bounds or a word of it, the others at their defaults."""
    for name, field in find(law).keys.model_fields.items():
        if name in ("denominator", "sections", "filter_file", "designed_us", "duration_us"):
            continue  # of `linear`, an unstable filter has no finite force
        if get_origin(field.annotation) is Literal:
            values = get_args(field.annotation)
        elif get_origin(field.annotation) is tuple:
            values = ([-1e6, 0.0, 1e6],)
        else:
            bounds = [info for info in field.metadata if isinstance(info, Ge | Le)]
            values = [getattr(info, "ge", getattr(info, "le", 0)) for info in bounds]
        yield from (NEEDED.get(law, {}) | {f"controller.{name}": value} for value in values)


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


LATENCIES_US = (0, 1000)
SAMPLES = ((1.0, 0.0), (-1.0, 1.0), (1e6, 1e-3))  # scale and noise


@pytest.mark.parametrize("law", default(shipped(), ["slope_threshold", "velocity_feedback"]))
def test_every_force_is_a_finite_number(law):
    tried = product(ends_of(law), LATENCIES_US, SAMPLES)
    for number, (values, latency_us, (scale, noise)) in enumerate(tried):
        keys = {"controller.law": law, "controller.latency_us": latency_us, **LONGER, **values}
        scene = load(SCENES[number % len(SCENES)]).vary(keys)
        assert np.isfinite(commands(scene, samples_of(scene, scale, noise, number))).all()


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
