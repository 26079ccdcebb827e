"""A repaired recording is the recording; that of a damaged one is in test_damages.py."""

import pytest

from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.recordings.repair import repair
from hertzloop.recordings.writer import RecordingError
from tests.recordings.rewriting import record


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return record(tmp_path_factory.mktemp("whole") / "a.mcap", compiled=True)


def test_whole_file_stays_whole(whole, tmp_path):
    repair(whole, tmp_path / "same.mcap")
    same = read(tmp_path / "same.mcap")
    assert not same.problems
    assert first_difference(read(whole), same) is None
    assert same.law_source == read(whole).law_source != ""
    assert same.result == read(whole).result


def test_nothing_to_repair(whole, tmp_path):
    (tmp_path / "none.mcap").write_bytes(whole.read_bytes()[:100])
    with pytest.raises(RecordingError, match="nothing to repair"):
        repair(tmp_path / "none.mcap", tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()
    (tmp_path / "out.mcap").write_text("mine")
    with pytest.raises(RecordingError, match="exists"):
        repair(whole, tmp_path / "out.mcap")
