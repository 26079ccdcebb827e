"""Published tables: how close they come, rows that were never published, and bad rows."""

import csv
from pathlib import Path

import pytest

from paper import tables
from tests.benchmarks.programs import called

PUBLISHED = Path(tables.__file__).parent


def computed(name: str) -> list[dict[str, str]]:
    rows = list(tables.compute_table(tables.read_rows(PUBLISHED / name), "thesis2008"))
    assert all(row["dT_computed"] for row in rows)
    return rows


@pytest.mark.full
def test_slope_threshold_rows():
    rows = computed("slope_threshold.csv")
    median = {a.column: a.median for a in tables.agreement(rows)}
    assert median["EAL"] <= 0.05
    assert median["EAH"] <= 0.4
    assert median["pup"] <= 0.3
    assert median["Evib"] <= 0.3
    assert median["Erad"] <= 0.3
    assert median["vpmax"] <= 0.4
    shares = tables.shares(rows)
    assert shares["vnext within 3 points"] >= 0.8
    assert shares["dT off by more than a step and 25 %"] == 0.0
    # The aim of 0.8 is missed by the rows that the README names.
    assert shares["dT within one step or 5 %"] == pytest.approx(11 / 15)


def test_parameter_study_rows():
    shares = tables.shares(computed("parameter_study.csv"))
    assert shares["dT within one step"] >= 0.85
    assert shares["vnext within 5 points"] >= 0.8


def test_rows_that_were_never_published(tmp_path):
    path, folder = tmp_path / "rows.csv", tmp_path / "out"
    path.write_text(
        "material,drop_height_m,kappa,v_thr_m_s,force,shape,t_a_step,EAL,note\n"
        "oak,0.2,0.37,-0.21,,,,-0.5,one\n"
        "sylomer_m,0.2,0.15,-0.3,,,,,two\n"
        "aluminium,0.2,-0.33,,F_a12,cosine,7,0.1,three\n"
        ",,0.3,,F_a1,,3,0.1,four\n"
        "oak,0.05,0.4,,,sine,5,0.1,five\n"
    )
    result = called(tables.main, str(path), "-o", str(folder))
    assert result.exit_code == 0, result.output
    with (folder / "rows-computed.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["note"] for row in rows] == ["one", "two", "three", "four", "five"]
    for row in rows:
        assert float(row["EAL_computed"]) != 0.0
        assert float(row["dT_computed"]) != 0.0
        if row["EAL"]:
            difference = float(row["EAL_computed"]) - float(row["EAL"])
            assert float(row["EAL_difference"]) == pytest.approx(difference, abs=1e-4)
    assert rows[1]["EAL_difference"] == ""
    assert list(rows[0])[7:10] == ["EAL", "EAL_computed", "EAL_difference"]


def test_consistent_scheme_computes_the_same_rows(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text("kappa,v_thr_m_s,vnext,dT\n0.8,-0.25,2.0,23.1\n")
    new_rows = list(tables.compute_table(tables.read_rows(path), "modal"))
    # The first contact lasts 597 us instead of 1335: no support, no "no rebound".
    assert float(new_rows[0]["dT_computed"]) == pytest.approx(-73.8, abs=0.2)


@pytest.mark.full
def test_a_contact_without_end_leaves_its_cells_empty(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text("material,kappa,v_thr_m_s,EAL\noak,0.95,-0.25,-1\n")
    new_rows = list(tables.compute_table(tables.read_rows(path), "thesis2008"))
    assert new_rows[0]["EAL_computed"] == new_rows[0]["EAL_difference"] == ""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("kappa,v_thr_m_s\nmuch,-0.25\n", "row 1: kappa = 'much': Input should be a valid number"),
        ("kappa\n0.3\n", "row 1: needs v_thr_m_s"),
        ("kappa,v_thr_m_s,material\n0.3,-0.2,steel wool\n", "material = 'steel wool'"),
        ("kappa,shape,t_a_step\n0.3,square,1\n", "row 1: square: must be one of F_a1,"),
        (
            "kappa,v_thr_m_s,EAL\n0.3,-0.25,big\n",
            "row 1: EAL: could not convert string to float: 'big'",
        ),
    ],
)
def test_bad_rows_are_the_users_mistake(tmp_path, text, words):
    path = tmp_path / "rows.csv"
    path.write_text(text)
    result = called(tables.main, str(path), "-o", str(tmp_path / "o"))
    assert result.exit_code == 2
    assert words in result.output
    missing = called(tables.main, str(tmp_path / "none.csv"), "-o", str(tmp_path / "o"))
    assert missing.exit_code == 2
    # Their results would go into one file.
    again = called(tables.main, "a/rows.csv", "b/rows.csv", "-o", str(tmp_path / "o"))
    assert again.exit_code == 2
    assert "rows.csv: named twice" in again.output
