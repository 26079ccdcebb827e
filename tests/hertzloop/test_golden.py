"""The recordings that ship: readable, and to the bit what the present code produces."""

import pytest

from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.scene.setup import parse
from tests.hertzloop.own_laws import ROOT
from tests.hertzloop.scenes import recorded

GOLDEN = ROOT / "recordings" / "golden"


@pytest.mark.parametrize("name", ["first-impact", "first-impact-2us-late"])
def test_the_same_run_today(name, tmp_path):
    golden = read(GOLDEN / f"{name}.mcap")
    assert not golden.problems
    today = recorded(parse(golden.scene_toml), tmp_path / "today.mcap")
    assert first_difference(golden, today) is None
