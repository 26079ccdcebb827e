"""A recording of another format version is refused, by every command that reads one."""

import pytest

from hertzloop.recordings import writer
from hertzloop.recordings.file_format import FORMAT_KEY, FORMAT_VERSION
from hertzloop.recordings.reader import read
from hertzloop.recordings.recovery import recover
from hertzloop.recordings.writer import RecordingError
from tests.commands import refused
from tests.recordings.rewriting import record


@pytest.mark.parametrize(
    ("name", "value", "found"),
    [
        ("FORMAT_VERSION", "999", "has format version '999'"),
        ("FORMAT_VERSION", "7\n" + 99 * "7", f"has format version '{20 * '7'}'"),
        ("FORMAT_KEY", "format", "has no format version"),
    ],
)
def test_another_format_version_is_refused(tmp_path, monkeypatch, name, value, found):
    monkeypatch.setattr(writer, name, value)
    monkeypatch.setattr(writer, "PROFILE", "hertzloop")
    path = record(tmp_path / "a.mcap")
    sentence = (
        f"{path} {found}, this hertzloop reads format version {FORMAT_VERSION}. Record the run "
        "again, or read the file with the version of hertzloop that wrote it."
    )
    with pytest.raises(RecordingError) as not_read:
        read(path)
    assert str(not_read.value) == sentence
    with pytest.raises(RecordingError) as not_recovered:
        recover(path, tmp_path / "b.mcap")
    assert str(not_recovered.value) == f"nothing to recover: {sentence}"
    for words in (["inspect"], ["replay", "--save", str(tmp_path / "a.rrd")]):
        refused(found, *words, path)


def test_a_damaged_format_version_does_not_make_a_recording_unreadable(tmp_path):
    path = record(tmp_path / "a.mcap")
    content = bytearray(path.read_bytes())
    content[content.index(FORMAT_KEY.encode())] ^= 0x40
    path.write_bytes(content)
    kept = read(path)
    assert "the file's description has no format version, unlike its header" in kept.problems
    assert kept.truth.samples == 2500
