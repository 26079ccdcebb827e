"""Hundreds of damaged and lying recordings: a sentence each, never a traceback, never "Complete"
for damage, never "the same" for other samples, and nothing lost that was not damaged."""

import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from mcap.opcode import Opcode
from rich.console import Console

import hertzloop.recordings.writer
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import SAMPLED, Recording, read, recover
from hertzloop.recordings.writer import RecordingError
from hertzloop.views import inspection
from tests.recordings.damaging import DAMAGES, lying
from tests.recordings.rewriting import Sent, messages, record

T = TypeVar("T")
ROUNDS = 30  # a kind of damage
LIES = 200


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A recording of many chunks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hertzloop.recordings.writer, "_FLUSH_EVERY_S", -1.0)
        yield record(tmp_path_factory.mktemp("fuzz") / "whole.mcap", "sensors.bits=16")


@pytest.fixture(scope="module")
def sent(whole: Path) -> list[Sent]:
    return messages(whole)


def heads(content: bytes) -> list[int]:
    """First bytes of the records up to the end of the data, the file's outermost level."""
    found = [8]
    while content[found[-1]] != Opcode.DATA_END:
        found.append(
            found[-1] + 9 + int.from_bytes(content[found[-1] + 1 : found[-1] + 9], "little")
        )
    return found


def samples(recording: Recording) -> dict[tuple[str, str], bytes]:
    return {
        (name, field): values.tobytes()
        for name in SAMPLED
        for field, values in getattr(recording, name).arrays.items()
    }


def tried(action: Callable[[], T]) -> tuple[T | None, str]:
    """What comes of it, or the sentence that says why not."""
    try:
        return action(), ""
    except RecordingError as error:
        return None, str(error)


def looked_at(path: Path, original: Recording) -> Recording | None:
    """Everything that is done with a recording, through to what a person sees; None if a sentence
    says that it is none."""
    kept, sentence = tried(lambda: read(path))
    if kept is None:
        assert str(path) in sentence
        assert "\n" not in sentence
        return None
    found = inspection.inspected(kept)
    data = inspection.summary(found)
    shown = io.StringIO()
    inspection.show(Console(file=shown, width=500), found)
    assert ("Complete" in shown.getvalue()) == (not data["problems"])
    assert data["complete"] == (not data["problems"])
    same = first_difference(original, kept) is None
    assert same == (first_difference(kept, original) is None)
    if same:
        assert samples(kept) == samples(original)
        assert sorted(map(repr, kept.events)) == sorted(map(repr, original.events))
    return kept


def recovered(path: Path, kept: Recording) -> None:
    """Recovery keeps all that is read."""
    out = path.with_name("recovered.mcap")
    out.unlink(missing_ok=True)
    copied, sentence = tried(lambda: recover(path, out))
    if copied is None:
        assert "nothing to recover" in sentence
        return
    after = read(out)
    assert samples(after) == samples(kept)
    assert after.events == kept.events
    assert after.problems or not kept.problems


@pytest.mark.full
@pytest.mark.parametrize("kind", range(len(DAMAGES)), ids=[d.__name__ for d in DAMAGES])
def test_damage(whole: Path, tmp_path: Path, kind: int) -> None:
    content, original, path = whole.read_bytes(), read(whole), tmp_path / "damaged.mcap"
    readable = 0
    for seed in range(ROUNDS):
        damaged = DAMAGES[kind](bytearray(content), np.random.default_rng([kind, seed]))
        if damaged == content:
            continue
        path.write_bytes(damaged)
        kept = looked_at(path, original)
        if kept is None:
            continue
        readable += 1
        assert kept.problems, seed
        for name in SAMPLED:
            stream, full = getattr(kept, name), getattr(original, name)
            steps = stream.step_at(np.arange(stream.samples))
            for field, values in stream.arrays.items():
                assert values.tobytes() == full.arrays[field][steps].tobytes(), (seed, field)
        recovered(path, kept)
    assert readable > ROUNDS // 2


@pytest.mark.full
def test_lies_with_right_checksums(whole: Path, sent: list[Sent], tmp_path: Path) -> None:
    original, path = read(whole), tmp_path / "lying.mcap"
    readable = 0
    for seed in range(LIES):
        lying(sent, whole, path, np.random.default_rng([99, seed]))
        kept = looked_at(path, original)
        if kept is not None:
            readable += 1
            recovered(path, kept)
    assert readable > LIES // 2


@pytest.mark.full
def test_one_flipped_byte_costs_one_chunk(whole: Path, tmp_path: Path) -> None:
    """Wherever it is, in the length of a record, too: nothing beyond that is believed."""
    content, original, path = whole.read_bytes(), read(whole), tmp_path / "flipped.mcap"
    lengths = [at + byte for at in heads(content) for byte in (1, 2, 3)]
    for at in [*np.linspace(0, len(content) - 1, 100, dtype=int).tolist(), *lengths]:
        damaged = bytearray(content)
        damaged[at] ^= 0x40
        path.write_bytes(damaged)
        out = tmp_path / "mended.mcap"
        recover(path, out, overwrite=True)
        kept = read(out)
        for name in SAMPLED:
            stream, full = getattr(kept, name), getattr(original, name)
            assert stream.messages >= full.messages - 1, at
        assert kept.problems, at
