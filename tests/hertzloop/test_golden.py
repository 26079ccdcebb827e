"""The recordings that ship: readable, and what the present code still produces."""

import pytest

from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.scene.setup import parse
from tests.hertzloop.own_laws import ROOT
from tests.hertzloop.scenes import recorded

GOLDEN = ROOT / "recordings" / "golden"
# Two processors may round differently in the exponentials of the model; over 4000 steps
# that grows to some 1e-12. Far below anything that a change of the model would do.
TOLERANCE = 1e-9


@pytest.mark.parametrize("name", ["first-impact", "first-impact-2us-late"])
def test_the_same_run_today(name, tmp_path):
    golden = read(GOLDEN / f"{name}.mcap")
    assert not golden.problems
    today = recorded(parse(golden.scene_toml), tmp_path / "today.mcap")
    assert first_difference(golden, today, TOLERANCE) is None
