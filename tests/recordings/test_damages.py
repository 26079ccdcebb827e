"""Damaged and lying recordings: a sentence each, never a traceback, never "Complete" for damage,
never "the same" for other samples, and nothing lost before the damage. A long series, with other
seeds: `tests.recordings.damages`."""

import io
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk

from hertzloop.bus import codec
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.writer import RecordingError, RecordingWriter
from tests.recordings.damages import (
    DAMAGES,
    check_beginnings,
    chunks,
    drawn,
    looked_at,
    many_chunks,
    records,
    repaired,
    scene_end,
    try_many,
)
from tests.recordings.rewriting import Sent, messages
from tests.tiers import default

TRIES, SEED = 27, 20
LIES = 100


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    return many_chunks(tmp_path_factory.mktemp("damages"))


@pytest.mark.parametrize("tries", default([TRIES, 15 * len(DAMAGES)], [TRIES]))
def test_damages(source, tmp_path, tries):
    tally = try_many(source, tmp_path, drawn(source.read_bytes(), tries, SEED))
    assert tally.wrong == [], f"python -m tests.recordings.damages --tries {tries} --seed {SEED}"
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
            repaired(path, tmp_path / "repaired.mcap", kept)
    assert readable > LIES // 2


def without_checksum(content: bytes, closed: bool) -> bytes:
    """The file with another last sample in its longest chunk, whose checksum is 0, as of a writer
    that leaves it out; `closed`: with the right checksum over all data, else cut off before it."""
    *others, (_, at, _) = records(content)
    _, first, last = max((b - a, a, b) for kind, a, b in others if kind == Opcode.CHUNK)
    chunk = Chunk.read(ReadDataStream(io.BytesIO(content[first + 9 : last])))
    inside = bytearray(zstandard.decompress(chunk.data))
    inside[-8] ^= 1
    changed = replace(chunk, data=bytes(inside), compression="", uncompressed_crc=0)
    changed.write(builder := RecordBuilder())
    data = content[:first] + builder.end() + content[last:at]
    if not closed:
        return data
    return data + content[at : at + 9] + struct.pack("<I", zlib.crc32(data)) + content[at + 13 :]


@pytest.mark.parametrize("closed", [True, False])
def test_a_chunk_of_ours_without_its_checksum_is_not_believed(source, tmp_path, closed):
    """MCAP lets a writer leave checksums out; hertzloop leaves none out."""
    path = tmp_path / "a.mcap"
    path.write_bytes(without_checksum(source.read_bytes(), closed))
    original, kept = read(source), read(path)
    assert "a checksum is missing" in " ".join(kept.problems)
    assert kept.truth.samples < original.truth.samples
    check_beginnings(kept, original)


def test_a_scene_of_ours_without_its_checksum_is_not_believed(source, tmp_path):
    content, path = bytearray(source.read_bytes()), tmp_path / "a.mcap"
    end = scene_end(content)
    content[end - 4 : end] = bytes(4)
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"holds no scene .*a checksum is missing"):
        read(path)


def test_what_is_damaged_is_said_by_its_place_and_the_step(source, tmp_path):
    content = source.read_bytes()
    parts = chunks(content)
    at = parts[len(parts) // 2][0]
    path = tmp_path / "cut.mcap"
    path.write_bytes(content[: at + 20])
    kept = read(path)
    words = f"the file is cut off or damaged at byte {at} of {at + 20}: "
    assert any(problem.startswith(words) for problem in kept.problems)
    step = kept.truth.end_step
    assert 0 < step < 2500
    assert f"readable to step {step:,} of 2,500 announced" in kept.problems
