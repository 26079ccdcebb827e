"""Damaged and lying recordings: a sentence each, never a traceback, never "Complete" for damage,
never "the same" for other samples, and nothing lost that was not damaged. A long series, with other
seeds: `tests.recordings.damages`."""

import struct
import zlib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode

from hertzloop.bus import codec
from hertzloop.recordings.mcap_records import unpack_chunk
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import SAMPLED, Recording
from hertzloop.recordings.recovery import recover
from hertzloop.recordings.writer import RecordingWriter
from tests.recordings.damages import (
    DAMAGES,
    chunks,
    drawn,
    looked_at,
    many_chunks,
    records,
    recovered,
    samples,
    scene_records,
    try_many,
    undamaged,
)
from tests.recordings.rewriting import Sent, messages
from tests.tiers import default

TRIES, SEED = 27, 20
LIES = 200


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    return many_chunks(tmp_path_factory.mktemp("damages"))


@pytest.mark.parametrize("tries", default([TRIES, 30 * len(DAMAGES)], [TRIES]))
def test_damages(source, tmp_path, tries):
    tally = try_many(source, tmp_path, drawn(source.read_bytes(), tries, SEED))
    assert tally.wrong == [], f"python -m tests.recordings.damages --tries {tries} --seed {SEED}"
    assert tally.lost == [], f"python -m tests.recordings.damages --tries {tries} --seed {SEED}"
    assert set(tally.tries) == {damage.__name__ for damage in DAMAGES}
    assert sum(tally.whole_chunks.values()) > tries


def lying(original: Recording, sent: list[Sent], path: Path, rng: np.random.Generator) -> None:
    """A recording with right checksums in which a payload, the scene or its description is not
    what was written."""

    def damaged(content: bytes) -> bytes:
        change = DAMAGES[rng.integers(len(DAMAGES))]
        return bytes(change(bytearray(content or b"x"), rng))

    scene, metadata, chosen = original.scene_toml, dict(original.metadata), rng.integers(4)
    if chosen == 0:
        scene = damaged(scene.encode()).decode("latin-1")
    elif chosen == 1:
        key = str(rng.choice(sorted(metadata)))
        metadata[key] = damaged(metadata[key].encode()).decode("latin-1")
    lies = set(rng.integers(len(sent), size=3).tolist()) if chosen > 1 else set()
    writer = RecordingWriter(path, overwrite=True)
    writer.scene(scene, metadata)
    for place, item in enumerate(sent):
        payload = codec.encode(item.header, **item.arrays)
        payload = damaged(payload) if place in lies else payload
        writer.write(item.stream, payload, item.number, item.time_ns)
    writer.finish(original.result)


@pytest.mark.full
def test_lies_with_right_checksums(source, tmp_path):
    original, sent, path = read(source), messages(source), tmp_path / "lying.mcap"
    readable = 0
    for seed in range(LIES):
        lying(original, sent, path, np.random.default_rng([99, seed]))
        kept = looked_at(path, original, shown=True)
        if kept is not None:
            readable += 1
            recovered(path, tmp_path / "recovered.mcap", kept)
    assert readable > LIES // 2


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


def test_chunks_in_any_order_are_recovered_in_theirs(source, tmp_path):
    """The one that says what messages are last, too."""
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
def test_a_length_that_is_wrong_hides_no_chunk(source, tmp_path, kind):
    """A record without a checksum says that it is longer than the chunks behind it."""
    content, at = source.read_bytes(), places(source)
    spans = at[9] - at[3]
    head = struct.pack("<BQ", kind, spans + 50)  # as if it ended within a chunk
    if kind == Opcode.SCHEMA:  # its pieces' lengths agree
        head += struct.pack("<HIII", 1, 0, 0, spans + 50 - 14)
    elif kind == Opcode.MESSAGE_INDEX:
        head += struct.pack("<HI", 1, spans + 50 - 6)
    assert not_recovered(source, content[: at[3]] + head + content[at[3] :], tmp_path) == []


def without_checksum(content: bytes, closed: bool) -> bytes:
    """The file with another last sample in its longest chunk, whose checksum is 0, as of a writer
    that leaves it out; `closed`: with the right checksum over all data, else cut off before it."""
    *others, (_, at, _) = records(content)
    _, first, last = max((b - a, a, b) for kind, a, b in others if kind == Opcode.CHUNK)
    inside = bytearray(unpack_chunk(content[first + 9 : last]))
    inside[-8] ^= 1
    head = content[first + 9 : first + 25] + struct.pack("<QIIQ", len(inside), 0, 0, len(inside))
    chunk = struct.pack("<BQ", Opcode.CHUNK, len(head) + len(inside)) + head + inside
    data = content[:first] + chunk + content[last:at]
    if not closed:
        return data
    return data + content[at : at + 9] + struct.pack("<I", zlib.crc32(data)) + content[at + 13 :]


@pytest.mark.parametrize("closed", [True, False])
def test_a_chunk_of_ours_without_its_checksum_is_not_believed(source, tmp_path, closed):
    """MCAP lets a writer leave checksums out; hertzloop leaves none out."""
    path = tmp_path / "a.mcap"
    path.write_bytes(without_checksum(source.read_bytes(), closed))
    original, kept = read(source), read(path)
    assert "are damaged: a checksum is missing" in " ".join(kept.problems)
    assert kept.truth.samples < original.truth.samples
    for name in SAMPLED:
        stream, full = getattr(kept, name), getattr(original, name)
        steps = stream.step_at(np.arange(stream.samples))
        for label, values in stream.arrays.items():
            assert full.arrays[label][steps].tobytes() == values.tobytes()


def test_a_scene_of_ours_without_its_checksum_is_not_believed(source, tmp_path):
    content, path = source.read_bytes(), tmp_path / "a.mcap"
    scene = scene_records(content)[0]
    path.write_bytes(content.replace(scene, scene[:-4] + bytes(4))[:-100])
    assert "are damaged: a checksum is missing" in " ".join(read(path).problems)


def test_only_what_is_damaged_is_said_to_be(source, tmp_path):
    """The record that ends the data is none: summary and footer behind it are still what they
    were."""
    content = bytearray(source.read_bytes())
    *_, (_, at, _) = records(content)
    content[at] = 0xFF
    path = tmp_path / "no_end.mcap"
    path.write_bytes(content)
    first, *more = read(path).problems
    assert f"bytes {at} to {at + 12} of {len(content)} are damaged" in first
    assert not [problem for problem in more if "a record of kind" in problem]
