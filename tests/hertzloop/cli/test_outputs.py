"""Files that a command writes: whole or not at all, and none that it would wait for."""

import errno
import os
import stat
import subprocess
from pathlib import Path

import pytest

from hertzloop.common.atomic_files import NotWritten, atomic_write, whole_file
from hertzloop.loop.in_process import record_in_process
from hertzloop.recordings.writer import RecordingError, RecordingWriter
from tests.commands import call, said
from tests.hertzloop.commands import HERTZLOOP
from tests.hertzloop.scenes import aluminium_3mm

_FULL = "No space left on device"


def test_a_file_is_replaced_by_a_whole_one_only(tmp_path):
    path = tmp_path / "a.csv"
    with whole_file(path) as unfinished:
        unfinished.write_text("begun")
        assert (unfinished.parent, unfinished.suffix) == (tmp_path, ".csv")
        assert unfinished.name.startswith(".")
        assert not path.exists()
    assert path.read_text() == "begun"
    for stops in (KeyboardInterrupt(), ValueError("x")):
        with pytest.raises(type(stops)):
            _written_half(path, stops)
        assert path.read_text() == "begun"
        assert list(tmp_path.iterdir()) == [path]


def _written_half(path: Path, error: BaseException) -> None:
    with whole_file(path) as unfinished:
        unfinished.write_text("half")
        raise error


def test_an_error_of_the_system_names_the_file(tmp_path):
    path = tmp_path / "a.csv"
    sentence = f"cannot write {path}: {_FULL}"
    with pytest.raises(NotWritten, match=sentence) as caught:
        _written_half(path, OSError(errno.ENOSPC, _FULL))
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, str(path))
    assert list(tmp_path.iterdir()) == []


def test_links_and_permissions_stay(tmp_path):
    (tmp_path / "folder").mkdir()
    path, link = tmp_path / "folder" / "a.txt", tmp_path / "link.txt"
    link.symlink_to(path)
    before = os.umask(0o027)
    try:
        atomic_write(link, "one")
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    path.chmod(0o604)
    atomic_write(link, b"two")
    assert link.is_symlink()
    assert path.read_text() == "two"
    assert stat.S_IMODE(path.stat().st_mode) == 0o604
    assert [one.name for one in path.parent.iterdir()] == ["a.txt"]


def test_a_pipe_is_refused_and_a_device_written_to(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(NotWritten, match="not a regular file"):
        atomic_write(pipe, "words")
    with pytest.raises(NotWritten, match="not a regular file"):
        atomic_write(tmp_path, "words")
    with pytest.raises(RecordingError, match="cannot create the recording"):
        RecordingWriter(pipe, overwrite=True)
    atomic_write(Path(os.devnull), "words")
    (tmp_path / "null").symlink_to(os.devnull)
    atomic_write(tmp_path / "null", "words")
    assert stat.S_ISCHR(Path(os.devnull).stat().st_mode)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("outputs") / "run.mcap"
    record_in_process(aluminium_3mm("run.duration_s=0.003"), path, compiled=True)
    return path


# A command with the options that name its output {}, and the ending of that.
_SAMPLED = [["export", "F.mcap", "-o", f"{{}}{end}"] for end in (".csv", ".parquet", ".mcap")]
_OUTPUTS = [
    *_SAMPLED,
    ["scene", "modes", "aluminium-3mm", "-o", "{}.csv"],
    ["repair", "F.mcap", "-o", "{}.mcap"],
    ["replay", "F.mcap", "--save", "{}.rrd", "--alone"],
    ["inspect", "F.mcap", "--json", "{}"],
    ["law", "new", "{}.py"],
    ["scene", "new", "{}.toml"],
    ["export-plant", "aluminium-3mm", "--cpu", "host", "-o", "{}.fmu"],
    ["report", "F.mcap", "--out-dir", "{}"],
    ["listen", "F.mcap", "--out-dir", "{}"],
    ["margin", "--set", "controller.law=velocity_feedback", "--out-dir", "{}"],
    ["export-plant", "aluminium-3mm", "--cpu", "host", "--out-dir", "{}"],
    ["node", "keys", "{}", "--hosts", "plant=a:1,controller=a:2,recorder=a:3"],
]


def _named(words: list[str], output: Path, recording: Path) -> list[str]:
    return [word.format(output).replace("F.mcap", str(recording)) for word in words]


def _name_of(words: list[str]) -> str:
    return " ".join(word for word in words[:4] if not word.startswith("-")).replace("{}", "x")


@pytest.fixture
def full(tmp_path):
    """A file system without room for a byte."""
    folder = tmp_path / "full"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", folder], capture_output=True, text=True
    )
    if mounted.returncode != 0:
        pytest.skip(f"no file system of one's own here: {mounted.stderr}")
    try:
        (folder / "filled").write_bytes(bytes(60 * 1024))
        yield folder
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


_SMALL = ("law", "scene", "inspect")  # fits into a page


@pytest.mark.full
@pytest.mark.parametrize("words", _OUTPUTS, ids=_name_of)
def test_a_full_disk_leaves_no_part(words, recording, full, here):
    """One page is free, or none for what would fit into it."""
    if words[0] in _SMALL:
        (full / "more").write_bytes(bytes(4096))
    before = sorted(full.iterdir())
    named = _named(words, full / "out", recording)
    result = call(*named)
    told = said(result)
    assert result.exit_code == 1, told
    assert "cannot write " in told
    assert _FULL in told
    assert "Traceback" not in told
    left = [path for path in full.rglob("*") if path.is_file()]
    assert sorted(left) == before
    assert not any(here.glob(".*"))


@pytest.mark.full
def test_an_existing_file_outlives_a_full_disk(recording, full):
    old = full / "out.mcap"
    old.write_bytes(b"old")
    result = call("repair", str(recording), "-o", str(old), "--overwrite")
    assert (result.exit_code, old.read_bytes()) == (1, b"old"), result.output
    assert f"cannot write {old}: {_FULL}" in said(result)


@pytest.mark.full
def test_results_that_find_no_room():
    words = [*HERTZLOOP, "scene", "show", "oak-20mm"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True)
    said = "error: cannot write standard output: No space left on device"
    assert (done.returncode, done.stderr.strip()) == (1, said)
