"""Cut off or flipped bytes: what is there is read, what is not is named, nothing else happens."""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader

import hertzloop.recordings.writer
from hertzloop.recordings.reader import Recording, read, unpacked
from hertzloop.recordings.writer import RecordingError
from tests.recordings.rewriting import record

STREAMS = ("daq", "force", "truth")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A recording flushed after every message: a chunk each, as in a long run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hertzloop.recordings.writer, "_FLUSH_EVERY_S", -1.0)
        yield record(tmp_path_factory.mktemp("damaged") / "whole.mcap", "sensors.bits=16")


def places(size: int, front: int = 120) -> list[int]:
    """Every byte at both ends, and many between."""
    ends = [*range(front), *range(size - 120, size)]
    return sorted({*ends, *np.linspace(0, size - 1, 400, dtype=int).tolist()})


def try_read(path: Path) -> Recording | None:
    """The recording, or None if a sentence says that it is none."""
    try:
        return read(path)
    except RecordingError as error:
        sentence = str(error)
    assert str(path) in sentence
    assert "\n" not in sentence
    return None


@pytest.mark.full
def test_cut_off_anywhere(whole: Path, tmp_path: Path) -> None:
    content, original = whole.read_bytes(), read(whole)
    path = tmp_path / "cut.mcap"
    before, readable = dict.fromkeys(STREAMS, 0), 0
    for cut in places(len(content), 3000):  # scene, metadata, the first messages
        path.write_bytes(content[:cut])
        kept = try_read(path)
        if kept is None:
            assert not readable, f"not read when cut at {cut}, but at {readable}"
            continue
        readable = cut
        assert kept.problems, cut
        assert kept.scene_toml == original.scene_toml
        for name in STREAMS:
            stream, full = getattr(kept, name), getattr(original, name)
            assert stream.samples >= before[name]
            before[name] = stream.samples
            for label, values in stream.arrays.items():
                assert full.arrays[label].tobytes().startswith(values.tobytes()), (cut, label)
        if kept.metadata and kept.truth.samples < original.truth.samples:
            assert f"stream 'truth' ends at step {kept.truth.samples} of 2500" in kept.problems
    assert before == {name: getattr(original, name).samples for name in STREAMS}


def test_a_cut_loses_only_what_was_behind_it(whole: Path, tmp_path: Path) -> None:
    """Half of the file holds about half of the chunks: all of them are read."""
    content = whole.read_bytes()
    with whole.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    ends = [c.chunk_start_offset + c.chunk_length for c in summary.chunk_indexes]
    assert len(ends) > 20
    path = tmp_path / "cut.mcap"
    for count in (1, len(ends) // 2, len(ends)):
        path.write_bytes(content[: ends[count - 1]])
        kept = read(path)
        found = [*kept.ends, *kept.events, *([kept.books] if kept.books else [])]
        messages = len(found) + sum(getattr(kept, name).messages for name in STREAMS)
        not_kept = ("hello", "text of the law")  # as messages
        assert messages == max(count - len(not_kept), 0)
        assert "the recorder did not finish the file" in kept.problems


@pytest.mark.full
def test_flipped_bits_anywhere(whole: Path, tmp_path: Path) -> None:
    """Each is reported, in the index behind the data, too."""
    content = whole.read_bytes()
    path = tmp_path / "flipped.mcap"
    silent = []
    for at in places(len(content)):
        damaged = bytearray(content)
        damaged[at] ^= 0x10
        path.write_bytes(damaged)
        kept = try_read(path)
        if kept is None or kept.problems:
            continue
        silent.append(at)
    assert not silent, silent


@pytest.mark.parametrize("part", [0.0, 0.5, 1.0])
def test_a_flipped_byte_in_a_chunk_is_reported(whole: Path, tmp_path: Path, part: float) -> None:
    """Before and after the damaged chunk everything is there, at its time."""
    with whole.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunk = max(summary.chunk_indexes, key=lambda c: c.chunk_length)
    damaged = bytearray(whole.read_bytes())
    # The compressed data are the last part of a chunk's record.
    first = chunk.chunk_start_offset + chunk.chunk_length - chunk.compressed_size
    damaged[first + int(part * (chunk.compressed_size - 1))] ^= 0xFF
    path = tmp_path / "flipped.mcap"
    path.write_bytes(damaged)
    kept = read(path)
    assert any("cut off or damaged" in problem for problem in kept.problems)
    original = read(whole)
    lost = sum(getattr(original, n).messages - getattr(kept, n).messages for n in STREAMS)
    assert lost <= 1
    for name in STREAMS:
        stream, full = getattr(kept, name), getattr(original, name)
        steps = stream.step_at(np.arange(stream.samples))
        assert np.array_equal(steps * 1000, stream.time_ns)
        for label, values in stream.arrays.items():
            assert full.arrays[label][steps].tobytes() == values.tobytes()


def without_checksum(content: bytes, closed: bool) -> bytes:
    """The file with another last sample in its longest chunk, whose checksum is 0, as of a writer
    that leaves it out; `closed`: with the right checksum over all data, else cut off before it."""
    at, chunks = 8, list[tuple[int, int]]()
    while content[at] != Opcode.DATA_END:
        length = int.from_bytes(content[at + 1 : at + 9], "little")
        if content[at] == Opcode.CHUNK:
            chunks.append((length, at))
        at += 9 + length
    length, first = max(chunks)
    records = bytearray(unpacked(content[first + 9 : first + 9 + length]))
    records[-8] ^= 1
    head = content[first + 9 : first + 25] + struct.pack("<QIIQ", len(records), 0, 0, len(records))
    chunk = struct.pack("<BQ", Opcode.CHUNK, len(head) + len(records)) + head + records
    data = content[:first] + chunk + content[first + 9 + length : at]
    if not closed:
        return data
    return data + content[at : at + 9] + struct.pack("<I", zlib.crc32(data)) + content[at + 13 :]


@pytest.mark.parametrize("closed", [True, False])
def test_a_chunk_of_ours_without_its_checksum_is_not_believed(
    whole: Path, tmp_path: Path, closed: bool
) -> None:
    """MCAP lets a writer leave checksums out; hertzloop leaves none out."""
    path = tmp_path / "a.mcap"
    path.write_bytes(without_checksum(whole.read_bytes(), closed))
    original, kept = read(whole), read(path)
    assert "are damaged: a checksum is missing" in " ".join(kept.problems)
    assert kept.truth.samples < original.truth.samples
    for name in STREAMS:
        stream, full = getattr(kept, name), getattr(original, name)
        steps = stream.step_at(np.arange(stream.samples))
        for label, values in stream.arrays.items():
            assert full.arrays[label][steps].tobytes() == values.tobytes()


def test_a_scene_of_ours_without_its_checksum_is_not_believed(whole: Path, tmp_path: Path) -> None:
    content = bytearray(whole.read_bytes())
    at = content.index(b"\x0a\x00\x00\x00scene.toml") - 25
    end = at + 9 + int.from_bytes(content[at + 1 : at + 9], "little")
    assert content[at] == Opcode.ATTACHMENT
    content[end - 4 : end] = bytes(4)
    path = tmp_path / "a.mcap"
    path.write_bytes(content[:-100])
    told = read(path).problems
    assert any("are damaged: a checksum is missing" in problem for problem in told)


def test_only_what_is_damaged_is_said_to_be(whole: Path, tmp_path: Path) -> None:
    """The record that ends the data is none: summary and footer behind it are still what they
    were."""
    content, at = bytearray(whole.read_bytes()), 8
    while content[at] != Opcode.DATA_END:
        at += 9 + int.from_bytes(content[at + 1 : at + 9], "little")
    content[at] = 0xFF
    path = tmp_path / "no_end.mcap"
    path.write_bytes(content)
    first, *more = read(path).problems
    assert f"bytes {at} to {at + 12} of {len(content)} are damaged" in first
    assert not [problem for problem in more if "a record of kind" in problem]
