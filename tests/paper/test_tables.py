"""Published tables: how close they come."""

from pathlib import Path

import pytest

from paper import tables

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


def test_consistent_scheme_computes_the_same_rows():
    row = {"kappa": "0.8", "v_thr_m_s": "-0.25", "vnext": "2.0", "dT": "23.1"}
    [computed] = tables.compute_table([row], "modal")
    # The first contact lasts 597 us instead of 1335: no support, no "no rebound".
    assert float(computed["dT_computed"]) == pytest.approx(-73.8, abs=0.2)


@pytest.mark.full
def test_a_contact_without_end_leaves_its_cells_empty():
    row = {"material": "oak", "kappa": "0.95", "v_thr_m_s": "-0.25", "EAL": "-1"}
    [computed] = tables.compute_table([row], "thesis2008")
    assert computed["EAL_computed"] == computed["EAL_difference"] == ""
