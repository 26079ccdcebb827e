"""Metrics of a recording that lacks steps: only what all steps from the start on show."""

import pytest

from hertzloop.recordings.reader import read
from hertzloop.results.inspection import inspected
from hertzloop.views.run_json import inspection_as_json
from tests.commands import call
from tests.recordings.rewriting import record, rewrite


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run whose only contact is in the second block of 1000 steps."""
    return record(tmp_path_factory.mktemp("missing") / "whole.mcap")


def without_block(whole, tmp_path, number):
    path = tmp_path / "gap.mcap"
    return rewrite(whole, path, lambda m: (m.stream, m.number) != ("truth", number))


@pytest.mark.parametrize(("number", "known"), [(0, False), (1, False), (2, True)])
def test_the_first_impact_is_known_if_no_step_is_missing_until_it_is_over(
    whole, tmp_path, number, known
):
    complete = inspection_as_json(inspected(read(whole)))
    found = inspection_as_json(inspected(read(without_block(whole, tmp_path, number))))
    assert complete["first_impact"]
    assert complete["whole_run"]
    assert found["first_impact"] == (complete["first_impact"] if known else None)
    assert found["impacts"] == (complete["impacts"] if known else [])
    assert found["whole_run"] is None
    assert any("No impact is known" in one for one in found["verdict"]) == (not known)


def test_an_unknown_number_of_contacts_is_not_printed(whole, tmp_path):
    told = call("inspect", without_block(whole, tmp_path, 2)).output
    [line] = [one for one in told.splitlines() if "contacts, whole run" in one]
    assert "unknown" in line


def test_an_unknown_first_impact_is_not_compared(whole, tmp_path):
    found = call("compare", whole, without_block(whole, tmp_path, 0), "--metrics")
    assert found.exit_code == 1
    assert "has no metrics" in found.output


def test_a_part_of_a_run_has_no_sound(whole, tmp_path):
    gap = without_block(whole, tmp_path, 2)
    found = call("listen", gap, "-o", tmp_path)
    assert found.exit_code == 1
    assert "step 2000 is missing" in found.output
    assert not list(tmp_path.glob("*.wav"))
