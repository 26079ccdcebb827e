"""Two runs and one file: one is refused, and one that never began leaves the file as it was."""

import pytest

from hertzloop.loop.in_process import record_in_process
from hertzloop.processes.record import what_is_kept
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError, RecordingWriter
from tests.hertzloop.commands import LONG, finish, grown_to, hertzloop, start, wait_for
from tests.hertzloop.scenes import aluminium_3mm

SHORT = ["run.duration_s=0.0025", "run.accuracy=0.1"]


@pytest.mark.full
def test_a_second_run_does_not_take_the_file_of_the_first(tmp_path):
    """Both may overwrite; the first one goes on and keeps its recording."""
    out = tmp_path / "one.mcap"
    first = start("run", *LONG, "--out", str(out), "--overwrite")
    try:
        wait_for(grown_to(out, 500_000), 120.0)
        size = out.stat().st_size
        second = hertzloop(
            "run", "aluminium-3mm", "--set", SHORT[0], "--out", str(out), "--overwrite", code=1
        )
        assert f"another run is writing {out}" in " ".join(second.stderr.split())
        assert out.stat().st_size >= size
    finally:
        first.send_signal(2)
        finish(first)
    assert read(out).metadata["steps"] == "15000000"


def test_a_file_is_locked_until_its_writer_is_done(tmp_path):
    out = tmp_path / "one.mcap"
    first = RecordingWriter(out)
    first.scene("# a", {})
    with pytest.raises(RecordingError, match="another run is writing"):
        RecordingWriter(out, overwrite=True)
    first.finish({})
    second = RecordingWriter(out, overwrite=True)
    second.scene("# b", {})
    second.finish({})
    assert read(out).scene_toml == "# b"


def test_a_run_that_never_began_leaves_the_file_as_it_was(tmp_path):
    old, new = tmp_path / "old.mcap", tmp_path / "new.mcap"
    record_in_process(aluminium_3mm(*SHORT), old, compiled=True)
    content = old.read_bytes()
    since_s = old.stat().st_mtime + 1.0
    RecordingWriter(old, overwrite=True).finish({"fault": "nobody came"})
    RecordingWriter(new).finish({"fault": "nobody came"})
    assert old.read_bytes() == content
    assert not new.exists()
    assert what_is_kept(old, since_s) == "no recording was written"
    assert what_is_kept(old, 0.0) == f"the recording up to now is in {old}"
    for strange in (b"", b"text", content[:100]):
        new.write_bytes(strange)
        assert what_is_kept(new, 0.0) == "no recording was written"
    assert what_is_kept(tmp_path / "none.mcap", 0.0) == "no recording was written"
