"""A recording that was cut off becomes a whole file again, as far as it goes."""

import math

import numpy as np
import pytest
from mcap.reader import make_reader

import hertzloop.recordings.writer
from hertzloop.loop.in_process import record_in_process
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.recordings.repair import repair
from hertzloop.recordings.writer import RecordingError
from hertzloop.scene.setup import load


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "a.mcap"
    with pytest.MonkeyPatch.context() as patch:
        # Chunks end where they are full, not where a busy machine pauses: a byte is always in the
        # same one. Long enough for several, since a chunk is what a cut loses.
        patch.setattr(hertzloop.recordings.writer, "_FLUSH_EVERY_S", math.inf)
        record_in_process(load("aluminium-3mm", ["run.duration_s=0.12"]), path, compiled=True)
    return path


def test_cut_off(whole, tmp_path):
    content = whole.read_bytes()
    cut, mended = tmp_path / "cut.mcap", tmp_path / "mended.mcap"
    cut.write_bytes(content[: int(0.8 * len(content))])
    copied = repair(cut, mended).messages
    with mended.open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == copied
    before, after = read(cut), read(mended)
    assert first_difference(before, after) is None
    assert 0 < after.truth.samples < 120_000
    xi = read(whole).truth.arrays["xi_m"]
    assert np.array_equal(after.truth.arrays["xi_m"], xi[: after.truth.samples])
    assert any("repaired from cut.mcap" in problem for problem in after.problems)
    assert after.law_source == read(whole).law_source


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
