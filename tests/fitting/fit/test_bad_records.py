"""A record that cannot be right is refused in a sentence; a spoilt one gives a right answer."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.synthetic_records import Spoilt, measured, truth
from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.fit.results import ModelVerdict
from hertzloop.fitting.records.record import Record
from tests.fitting.fitting import RADIUS, assert_holds, fitted, record, scene


def changed(one: Record, value: np.ndarray, time_s: np.ndarray | None = None) -> Record:
    return replace(one, value=value, time_s=one.time_s if time_s is None else time_s)


@pytest.mark.parametrize(
    ("value", "scale_s", "words"),
    [
        (lambda v: v, 1e6, "that time_s is in seconds"),
        (lambda v: v, 1e-3, "that time_s is in seconds"),
        (lambda v: 1000.0 * v, 1.0, "times the simulation"),
        (lambda v: -v, 1.0, "opposite sign"),
        (lambda v: 0.2 * np.random.default_rng(1).standard_normal(len(v)), 1.0, "no impact"),
        (lambda v: np.zeros(len(v)), 1.0, "with an impact"),
        (
            lambda v: np.where(v == v.max(), v, np.sin(np.arange(len(v)) ** 2)),
            1.0,
            "impact is shorter",
        ),
    ],
)
def test_a_record_that_cannot_be_right_is_refused(value, scale_s, words):
    one = record(scene())
    with pytest.raises(RecordError, match=words):
        fitted(scene(), changed(one, value(one.value), scale_s * one.time_s), RADIUS)


def spoilt(kind: str) -> Record:
    """A record of 3 mm that an instrument spoilt."""
    one = record(scene())
    if kind == "clipped":
        return changed(one, np.minimum(one.value, 60.0))
    if kind == "not numbers":
        value = one.value.copy()
        value[100:110] = value[520] = np.nan
        return changed(one, value)
    if kind == "a sparse start":
        sparse = np.arange(-2000.0, 0.0) - 1.0
        quiet = 0.2 * np.random.default_rng(0).standard_normal(len(sparse))
        return changed(one, np.append(quiet, one.value), np.append(sparse, one.time_s))
    if kind == "no start":
        late = one.time_s > one.time_s[np.argmax(one.value)] - 12e-6
        return changed(one, one.value[late], one.time_s[late])
    # five samples in a contact
    seen = truth(scene(), "contact_force", 80e-6, accuracy=1e-4)
    return measured(seen, Spoilt(), 3, rate_hz=2e5, quiet_s=2e-3)


@pytest.mark.parametrize("kind", ["clipped", "not numbers", "a sparse start", "no start", "coarse"])
def test_a_spoilt_record_gives_the_right_answer(kind):
    found = fitted(scene(), spoilt(kind), RADIUS)
    off = 1e-2 if kind == "no start" else 5e-3
    assert found.estimates[0].value == pytest.approx(0.003, rel=off)
    if kind in ("clipped", "coarse"):
        assert_holds(found, 0.003)
    if kind == "no start":
        assert found.model is ModelVerdict.CANNOT_TELL
    assert any("end of the range" in note for note in found.notes) == (kind == "clipped")


def test_a_second_drop_in_a_record_is_named():
    one = record(scene())
    later = one.time_s[-1] - one.time_s[0] + one.interval_s
    twice = changed(one, np.tile(one.value, 2), np.concatenate([one.time_s, one.time_s + later]))
    found = fitted(scene(), twice, RADIUS)
    assert found.model is ModelVerdict.DOES_NOT_FIT
    assert any("us after the first is not in the simulation" in reason for reason in found.reasons)
