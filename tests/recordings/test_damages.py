"""A short series of damages; long ones, with other seeds: see `tests.recordings.damages`."""

import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode

import hertzloop.recordings.reader
from hertzloop.recordings.reader import Source, in_order, read, recover
from hertzloop.recordings.writer import RecordingError
from tests.recordings.damages import (
    DAMAGES,
    chunks,
    many_chunks,
    samples,
    scene_records,
    try_many,
    undamaged,
)

TRIES, SEED = 45, 20


def test_damages(tmp_path: Path) -> None:
    source = many_chunks(tmp_path)
    tally = try_many(source, tmp_path, TRIES, SEED)
    assert tally.wrong == [], f"python -m tests.recordings.damages --tries {TRIES} --seed {SEED}"
    assert tally.lost == [], f"python -m tests.recordings.damages --tries {TRIES} --seed {SEED}"
    assert set(tally.tries) == {damage.__name__ for damage in DAMAGES}
    assert sum(tally.whole_chunks.values()) > TRIES


def not_recovered(source: Path, moved: bytes, folder: Path) -> list[int]:
    """Which chunks of `source` are not in what is recovered from `moved`, which has them all."""
    parts, path, out = chunks(source.read_bytes()), folder / "moved.mcap", folder / "again.mcap"
    assert len(undamaged(moved, parts)) == len(parts)
    path.write_bytes(moved)
    kept, original = read(path), read(source)
    assert "the file is cut off or damaged" in " ".join(kept.problems)
    assert samples(kept) == samples(original)
    recover(path, out)
    have = {one for _, inside in chunks(out.read_bytes()) for one in inside}
    assert samples(read(out)) == samples(original)
    return [n for n, (_, payloads) in enumerate(parts) if not have.issuperset(payloads)]


def places(source: Path) -> list[int]:
    """First byte of every chunk, and where the last one ends."""
    content = source.read_bytes()
    found = [(content.find(chunk), len(chunk)) for chunk, _ in chunks(content)]
    return [*(at for at, _ in found), sum(found[-1])]


def test_chunks_behind_the_end_of_the_data_are_recovered(tmp_path: Path) -> None:
    """Parts of the file have changed places: its end came before some of its chunks."""
    source = many_chunks(tmp_path)
    content, at = source.read_bytes(), places(source)
    middle = at[len(at) // 2]
    moved = content[:middle] + content[at[-1] :] + content[middle : at[-1]]
    assert not_recovered(source, moved, tmp_path) == []


def test_chunks_in_any_order_are_recovered_in_theirs(tmp_path: Path) -> None:
    """The one that says what messages are last, too."""
    source = many_chunks(tmp_path)
    content, at = source.read_bytes(), places(source)
    pieces = [content[a:b] for a, b in pairwise(at)]
    for order in (range(len(pieces))[::-1], np.random.default_rng(3).permutation(len(pieces))):
        mixed = b"".join(pieces[n] for n in order)
        assert not_recovered(source, content[: at[0]] + mixed + content[at[-1] :], tmp_path) == []
        (tmp_path / "again.mcap").unlink()
    assert (
        "parts of the file have changed places, or are there twice"
        in read(tmp_path / "moved.mcap").problems
    )


@pytest.mark.parametrize("kind", [Opcode.SCHEMA, Opcode.STATISTICS, Opcode.MESSAGE_INDEX])
def test_a_length_that_is_wrong_hides_no_chunk(tmp_path: Path, kind: Opcode) -> None:
    """A record without a checksum says that it is longer than the chunks behind it."""
    source = many_chunks(tmp_path)
    content, at = source.read_bytes(), places(source)
    spans = at[9] - at[3]
    head = struct.pack("<BQ", kind, spans + 50)  # as if it ended within a chunk
    if kind == Opcode.SCHEMA:  # its pieces' lengths agree
        head += struct.pack("<HIII", 1, 0, 0, spans + 50 - 14)
    elif kind == Opcode.MESSAGE_INDEX:
        head += struct.pack("<HI", 1, spans + 50 - 6)
    assert not_recovered(source, content[: at[3]] + head + content[at[3] :], tmp_path) == []


def test_a_scene_behind_the_end_of_the_data_is_found(tmp_path: Path) -> None:
    source = many_chunks(tmp_path)
    content = source.read_bytes()
    [scene, hello] = scene_records(content)
    without = content.replace(scene, b"").replace(hello, b"")
    (tmp_path / "none.mcap").write_bytes(without)
    with pytest.raises(RecordingError, match="holds no scene"):
        read(tmp_path / "none.mcap")
    (tmp_path / "last.mcap").write_bytes(without + scene)
    assert read(tmp_path / "last.mcap").scene_toml == read(source).scene_toml


def test_what_seems_a_chunk_everywhere_is_not_checked_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Heads of chunks by the thousand, all of the same data: only some are tried."""
    source = many_chunks(tmp_path)
    content, at = source.read_bytes(), places(source)
    count, head, data = 1000, 9 + 32 + 8, bytes(1 << 20)
    sizes = [left * head + len(data) for left in reversed(range(count))]
    heads = b"".join(
        struct.pack("<BQQQQIIQ", Opcode.CHUNK, 40 + size, 0, 0, size, 1, 0, size) for size in sizes
    )
    path, tried = tmp_path / "heads.mcap", list[int]()

    def unpacked(content: bytes) -> bytes:
        tried.append(len(content))
        return unpacked_before(content)

    unpacked_before = hertzloop.recordings.reader.unpacked
    monkeypatch.setattr(hertzloop.recordings.reader, "unpacked", unpacked)
    monkeypatch.setattr(hertzloop.recordings.reader, "TOTAL_BYTES", 20 << 20)
    monkeypatch.setattr(hertzloop.recordings.reader, "TOTAL_RATIO", 1)
    path.write_bytes(content[: at[-1]] + heads + data + content[at[-1] :])
    opened = Source(path)
    found = [record for record in opened.walk().records() if record.opcode == Opcode.CHUNK]
    assert len(found) == len(at) - 1
    assert len(found) + 2 < len(tried) < len(found) + 20


def test_no_order_suits_a_forged_file() -> None:
    """Each part is there once all the same."""
    assert in_order([{"daq": 1}, {"daq": 0}, {}]) == [1, 0, 2]
    assert in_order([{"daq": 0, "force": 1}, {"daq": 1, "force": 0}, {"daq": 2}]) == [0, 1, 2]
    draw = np.random.default_rng(1)
    for _ in range(50):
        parts = [{s: int(draw.integers(9)) for s in ("daq", "truth", "force")} for _ in range(9)]
        assert sorted(in_order(parts)) == list(range(9))
