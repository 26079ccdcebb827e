"""The `[record]` table: values that are refused, and what they must be."""

import math

import pytest

from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.measurement import parse_record_table
from hertzloop.fitting.records.reading import read_records


@pytest.mark.parametrize(("key", "value", "wanted"), [
    ("bits", "12", "a whole number from 1 to 64"), ("bits", -1, "a whole number from 1 to 64"),
    ("bits", True, "a whole number from 1 to 64"), ("bits", 12.0, "a whole number from 1 to 64"),
    ("set", 3, "a table of scene keys"), ("quantity", ["a"], "a name"),
    ("range", [5, -5], "two rising numbers"), ("range", [5, 5], "two rising numbers"),
    ("range", "15", "two rising numbers"), ("range", [0, math.inf], "two rising numbers"),
    ("point_m", [0.1], "two numbers"), ("sensitivity", 0, "a number other than zero"),
    ("sensitivity", math.inf, "a number other than zero"),
    ("sensitivity_uncertainty", -0.1, "zero, a positive number or inf"),
    ("clock_tolerance_ppm", math.inf, "zero or a positive number"),
    ("rate_hz", -1e6, "a positive number"), ("low_pass_hz", "50", "a positive number"),
    ("column", True, "a name or a number from 1 on"), ("control", 1, "true or false"),
])  # fmt: skip
def test_a_wrong_value_is_refused(key, value, wanted):
    with pytest.raises(RecordError) as refused:
        parse_record_table({key: value}, "drop.csv")
    assert str(refused.value) == f"record.{key} = {value}: must be {wanted} in drop.csv."


def test_right_values_are_kept():
    table = {
        "bits": 12,
        "range": [-5, 5.0],
        "point_m": (0.1, 0.2),
        "sensitivity": -0.01,
        "sensitivity_uncertainty": math.inf,
        "clock_tolerance_ppm": 0,
        "set": {"a": 1},
        "quantity": "v_p",
        "column": 2,
        "group": "a",
    }
    found = parse_record_table(table, "drop.csv")
    assert vars(found) | table | {"range": (-5.0, 5.0)} == vars(found)


def test_a_list_of_records_does_not_name_itself(tmp_path):
    path = tmp_path / "drop.toml"
    path.write_text('[[record]]\nfile = "drop.toml"\n')
    with pytest.raises(RecordError, match=r"drop\.toml: record\.file = 'drop\.toml': is a TOML"):
        read_records(path)


def test_a_list_of_records_beside_its_file_is_no_table_of_it(tmp_path):
    rows = "".join(f"{i * 1e-6},{i % 7}\n" for i in range(40))
    (tmp_path / "drop.csv").write_text("time (s),force (N)\n" + rows)
    path = tmp_path / "drop.toml"
    path.write_text('[[record]]\nfile = "drop.csv"\nquantity = "contact_force"\n')
    assert [one.quantity for one in read_records(path)] == ["contact_force"]
    assert read_records(tmp_path / "drop.csv", {"quantity": "contact_force"})
