"""The `[record]` table and records of arrays: what is refused, and what is kept."""

import math

import numpy as np
import pytest

import hertzloop
from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.records.measurement import parse_record_table
from tests.fitting.fitting import RADIUS, record, scene, write_csv


@pytest.mark.parametrize(("key", "value"), [
    ("bits", 12.0), ("bits", 12), ("set", 3), ("quantity", ["a"]), ("range", [5, 5]),
    ("range", [0, math.inf]), ("point_m", [0.1]), ("sensitivity", 0),
    ("sensitivity_uncertainty", -0.1), ("clock_tolerance_ppm", math.inf), ("rate_hz", True),
    ("low_pass", "elliptic"), ("low_pass_order", 2), ("column", 0), ("control", 1),
    ("decimal", ";"), ("clock", "daq"),
])  # fmt: skip
def test_a_wrong_value_is_refused_by_the_name_of_its_key(key, value):
    with pytest.raises(RecordError, match=rf"^record\.{key}\b.* drop\.csv\."):
        parse_record_table({key: value}, "drop.csv")


def test_a_record_of_arrays_is_fitted_beside_a_file(tmp_path):
    """The same drop twice: from a file, and from lists with keys of a table."""
    file, other = write_csv(tmp_path / "drop.csv", record(scene())), record(scene(), seed=9)
    arrays = hertzloop.Record(
        "again",
        other.time_s.tolist(),
        other.value.tolist(),
        "contact_force",
        {"clock_tolerance_ppm": 25.0},
    )
    start = hertzloop.load("aluminium-3mm", {"controller.law": "off", RADIUS: 0.0031})
    found = hertzloop.fit(start, [file, arrays], [RADIUS])
    [estimate] = found.estimates
    assert estimate.low < 0.003 < estimate.high
    assert [one.name for one in found.records] == ["drop.csv", "again"]


def test_times_that_a_double_cannot_resolve_are_refused():
    with pytest.raises(RecordError, match=r"to 2\.4e-07 s only\. Subtract the time of the first"):
        hertzloop.Record("drop", 1.6e9 + 1e-6 * np.arange(30.0), np.ones(30), "contact_force")


@pytest.mark.parametrize(("values", "quantity", "table", "words"), [
    (np.ones(30), "force", {}, r"record\.quantity = 'force': not known"),
    (np.ones(29), "contact_force", {}, r"times of shape \(30,\) and values of shape \(29,\)"),
    (np.full(30, np.nan), "contact_force", {}, "has 0 samples that are numbers"),
    (np.ones(30), "contact_force", {"unit": "kN"}, r"record\.unit: describes a file"),
    (np.ones(30), "contact_force", {"point_m": [0.1, 0.1]}, "has no measuring point"),
])  # fmt: skip
def test_arrays_that_are_no_record_are_refused(values, quantity, table, words):
    with pytest.raises(RecordError, match=words):
        hertzloop.Record("drop", np.arange(30.0), values, quantity, table)
