"""A recording from elsewhere may say anything: two runs in one, times out of the calendar, a
thousandfold when unpacked."""

import struct
import subprocess
import zlib

import pytest
import zstandard
from foxglove_schemas_protobuf.Log_pb2 import Log
from mcap.opcode import Opcode

from hertzloop.bus.messages_pb2 import Hello
from hertzloop.recordings import run_reader
from hertzloop.recordings.mcap_file import RECORD_BYTES
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError, RecordingWriter
from tests.commands import call
from tests.hertzloop.commands import python
from tests.recordings.damages import scene_end
from tests.recordings.rewriting import Sent, messages, record, rewrite, write


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return record(tmp_path_factory.mktemp("untrusted") / "whole.mcap")


def test_a_second_hello_with_an_empty_scene(whole, tmp_path):
    """The first is the run's; the second is named."""
    source, path = read(whole), tmp_path / "two.mcap"
    writer = RecordingWriter(path)
    writer.scene(source.scene_toml, source.metadata)
    for item in messages(whole):
        payload = item.header.SerializeToString()
        if item.stream == "hello":
            writer.write("hello", payload, 0, 0)
            second = Hello(run_id=item.header.run_id)
            writer.scene("", {**source.metadata, "scene": "", "steps": "7"})
            writer.write("hello", second.SerializeToString(), 1, 0)
    writer.finish(source.result)
    kept = read(path)
    assert kept.scene_toml == source.scene_toml
    assert kept.metadata == source.metadata
    assert "there is a second scene; the first is used" in kept.problems
    assert any("a second message came on stream 'hello'" in problem for problem in kept.problems)


def test_an_event_before_the_run(whole, tmp_path):
    path = tmp_path / "a.mcap"
    source = read(whole)
    writer = RecordingWriter(path)
    writer.scene(source.scene_toml, source.metadata)
    event = Log(name="plant", message="never")
    event.timestamp.seconds = -5
    writer.write("events/plant", event.SerializeToString(), 0, 2**63 - 1)
    with pytest.raises(RecordingError, match="stream 'events/plant' sequence 1 is at -5 ns"):
        writer.write("events/plant", b"", 1, -5)
    writer.finish({})
    kept = read(path)
    assert kept.events == []
    assert any("an event at -5 s and 0 ns" in words for words in kept.problems)


def test_there_is_an_end_to_events(whole, tmp_path, monkeypatch):
    path, source = tmp_path / "many.mcap", read(whole)
    writer = RecordingWriter(path)
    writer.scene(source.scene_toml, source.metadata)
    payload = Log(name="plant", message="contact").SerializeToString()
    for number in range(1500):
        writer.write("events/plant", payload, number, 0)
    writer.finish({})
    monkeypatch.setattr(run_reader, "MOST_EVENTS", 1000)
    kept = read(path)
    assert len(kept.events) == 1000
    assert "more than 1000 events" in kept.problems[0]
    assert len(kept.problems) < 60


def packed_chunk(size: int) -> bytes:
    """The record of a chunk in which one record of `size` bytes, all zero, is packed."""
    head = struct.pack("<BQ", 0x80, size - 9)
    packer, checksum = zstandard.ZstdCompressor(level=1).compressobj(), zlib.crc32(head)
    parts, zeros = [packer.compress(head)], bytes(1 << 20)
    left = size - len(head)
    while left:
        piece = zeros[:left]
        checksum = zlib.crc32(piece, checksum)
        parts.append(packer.compress(piece))
        left -= len(piece)
    data = b"".join([*parts, packer.flush()])
    content = struct.pack("<QQQI", 0, 0, size, checksum) + struct.pack("<I", 4) + b"zstd"
    content += struct.pack("<Q", len(data)) + data
    return struct.pack("<BQ", Opcode.CHUNK, len(content)) + content


@pytest.mark.full
@pytest.mark.parametrize(
    ("size", "count", "words"),
    [
        (1 << 30, 8, "would unpack to 1073741824"),
        (RECORD_BYTES, 40, "more than a recording may hold"),
    ],
)
def test_a_bomb(whole, tmp_path, size, count, words):
    """Gigabytes in some kilobytes: said in a sentence, and not unpacked at once."""
    path, content = tmp_path / "bomb.mcap", whole.read_bytes()
    start = scene_end(content)
    path.write_bytes(content[:start] + packed_chunk(size) * count + content[start:])
    assert path.stat().st_size < 5e5
    done, used = measured("inspect", path, code=1)
    assert words in " ".join(done.stdout.split())
    assert used < 600e6, used


def measured(*words: object, code: int = 0) -> tuple[subprocess.CompletedProcess, float]:
    """A command, run to its end with an exit code, and the most memory it held, bytes."""
    script = (
        "import resource, subprocess, sys;"
        "done = subprocess.run([sys.executable, '-m', 'hertzloop', *sys.argv[1:]]);"
        "print('peak', resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, file=sys.stderr);"
        "sys.exit(done.returncode)"
    )
    done = python("-c", script, *words, code=code)
    peak = int(done.stderr.rsplit("peak", 1)[1])
    return done, peak * 1024.0


def test_a_hello_of_another_scene_that_is_as_long(whole, tmp_path):
    source = read(whole)
    other = source.scene_toml.replace('"steel"', '"glass"')
    assert other != source.scene_toml

    def change(sent: Sent) -> None:
        if sent.stream == "hello":
            sent.header.scene_toml, sent.header.seed = other, sent.header.seed + 1

    path = rewrite(whole, tmp_path / "a.mcap", change)
    told = read(path).problems
    assert "the hello has another scene than the file" in told
    assert any(words.startswith("seed is '") for words in told)


# A terminal's title, clearing it, the same in C1, right to left, hidden, and markup of rich.
EVIL = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202egnol\u2066\u200b[red]\x7f"


@pytest.fixture(scope="module")
def evil(whole, tmp_path_factory):
    """A recording with characters that control a terminal wherever it holds text."""
    path, sent = tmp_path_factory.mktemp("evil") / "evil.mcap", messages(whole)
    for item in sent:
        if item.stream.startswith("end/"):
            item.header.report.law = EVIL
        elif item.stream.startswith("events/"):
            item.header.message = EVIL
    toml = "".join(f"\\u{ord(c):04x}" for c in EVIL)
    scene = read(whole).scene_toml.replace('"steel"', f'"steel{toml}"')
    words = dict.fromkeys(("scene", "run_id", "hertzloop", "host", "python", "note"), EVIL)
    return write(path, whole, sent, f'title = "{toml}"\n{scene}', **words)


def test_no_text_of_a_recording_controls_the_terminal(evil, whole, tmp_path):
    controlling = set(EVIL) - set(map(chr, range(32, 127)))
    for words in (
        ["inspect", evil],
        ["inspect", evil, "--details"],
        ["compare", evil, whole],
        ["replay", evil, "--save", tmp_path / "a.rrd"],
        ["replay", evil, whole, "--save", tmp_path / "b.rrd"],
        ["export", evil, "--out", tmp_path / "c.csv"],
        ["report", evil, "--out", tmp_path / "d.html"],
        ["repair", evil, "--out", tmp_path / "e.mcap"],
        ["law", "replay", EVIL, evil],
        ["run", EVIL],
        ["scene", "show", evil],
        ["inspect", tmp_path / EVIL.replace("/", "")],
    ):
        done = call(*words)
        assert not controlling & set(done.output), (words, done.output)
        assert done.exception is None or isinstance(done.exception, SystemExit), words
        if words[0] == "inspect":
            assert "\\x1b[2J\\x9b31m\\u202egnol\\u2066\\u200b[red]\\x7f" in done.output
