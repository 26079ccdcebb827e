"""Scenes of arbitrary and of extreme values: a scene or one sentence, and parts that run."""

from typing import Any, get_args

import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hertzloop.loop.simulate import simulate
from hertzloop.results.metrics import metrics_of
from hertzloop.scene.errors import SceneError
from hertzloop.scene.fields import parts_of
from hertzloop.scene.loading import load, parse, shipped
from hertzloop.scene.scene import Scene
from hertzloop.scene.setup import resolve

TABLES = {name: field.annotation for name, field in Scene.model_fields.items()}
KEYS = [
    (table, key)
    for table, model in TABLES.items()
    if hasattr(model, "model_fields")
    for key in model.model_fields
]
NUMBERS = (
    st.integers()
    | st.integers(-(2**80), 2**80)
    | st.floats()
    | st.sampled_from([0, 1, -1, 5e-324, 1e-300, 1e155, 1e300, -1e300, 2**63, 10**400])
)
WORDS = st.text(max_size=20) | st.sampled_from(
    ["[red]", "[/y]", "auto", "none", "ideal", "x" * 9999]
)
VALUES = st.recursive(
    NUMBERS | WORDS | st.booleans() | st.dates() | st.datetimes() | st.times(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=6,
)
LONGEST_SENTENCE = 1000


def scene_or_sentence(text: str, changes: list[str] | None = None) -> Scene | None:
    """The scene; None where it is refused in a sentence."""
    try:
        return parse(text, changes or [])
    except SceneError as error:
        said = str(error)
    assert 0 < len(said) <= LONGEST_SENTENCE, said
    return None


@pytest.mark.full
@settings(max_examples=120, suppress_health_check=list(HealthCheck))
@given(
    st.sampled_from(shipped()),
    st.dictionaries(st.sampled_from(KEYS), VALUES, max_size=3),
    st.dictionaries(WORDS, VALUES, max_size=2),
)
def test_any_values_make_a_scene_or_a_sentence(name, changes, more):
    data = load(name).model_dump(exclude_none=True)
    for (table, key), value in changes.items():
        data[table][key] = value
    scene_or_sentence(tomli_w.dumps({**data, **more}))
    base = tomli_w.dumps(load(name).model_dump(exclude_none=True))
    scene_or_sentence(base, [f"{t}.{k}={v}" for (t, k), v in changes.items() if v not in ("", {})])


def extremes(table: str, key: str) -> st.SearchStrategy[Any]:
    """The bounds of a key, zero and one; or its words; alone and as a list of two."""
    field = TABLES[table].model_fields[key]
    kinds = (field.annotation, *get_args(field.annotation))
    words = [word for kind in kinds for word in get_args(kind) if isinstance(word, str)]
    ends = ("ge", "gt", "le", "lt")
    found = [getattr(one, end) for one in parts_of(field) for end in ends if hasattr(one, end)]
    bounds = found or [1e-9, 0.1, 10.0]
    numbers = [int(n) if n == int(n) else n for n in (*bounds, 0.0, 1.0)]
    one = st.sampled_from([*words, *numbers])
    return one | st.lists(st.sampled_from(numbers), min_size=2, max_size=2)


@pytest.mark.full
@settings(max_examples=80, suppress_health_check=list(HealthCheck))
@given(st.sampled_from(shipped()), st.data())
def test_parts_of_extreme_scenes_can_be_built_and_run(name, data):
    keys = data.draw(st.lists(st.sampled_from(KEYS), unique=True, max_size=4))
    scene = load(name).model_dump(exclude_none=True)
    scene["run"]["lead_in_s"] = 1e-5
    for table, key in keys:
        scene[table][key] = data.draw(extremes(table, key), f"{table}.{key}")
    if ("controller", "law") in keys and ("sensors", "quantity") not in keys:
        scene["sensors"]["quantity"] = "auto"
    step_ns = scene["run"]["step_ns"]
    if isinstance(step_ns, int) and step_ns > 0:
        scene["run"]["duration_s"] = (
            200 * step_ns * 1e-9
        )  # the times of an extreme run are not the point
    found = scene_or_sentence(tomli_w.dumps(scene))
    if found is None or found.controller.law == "precomputed":
        return
    try:
        spec = resolve(found).plant
        if spec.plate.modes_below(spec.frequency_limit_hz) > 30_000:
            return  # could be built, but not within the time of a test
        run = simulate(resolve(found))
    except SceneError as error:
        said = str(error)
    else:
        metrics_of(resolve(found), run.truth)
        return
    assert 0 < len(said) <= LONGEST_SENTENCE, said
