"""Damages of a recording by the thousand: `python -m tests.recordings.damages --tries 2000`.

Of every damaged copy: no traceback, no hang, little memory, never "complete", never "the same" for
other samples, every chunk read that ends before the first damaged byte. A copy whose scene is
damaged is no recording. A seed is drawn, and printed, if none is given.
"""

import argparse
import io
import resource
import secrets
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from rich.console import Console

import hertzloop.recordings.writer
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import SAMPLED, Recording
from hertzloop.recordings.repair import repair
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.inspection import inspected
from hertzloop.views.report import print_inspection
from hertzloop.views.run_json import inspection_as_json
from tests.recordings.rewriting import record
from tests.tables import markdown

LONGEST_S = 120  # for one copy: far more than any takes, on a busy machine, too
MOST_BYTES = 2 * 2**30
SHOWN = 28  # each such copy is shown, too, which takes long: another kind every time


Change = Callable[[bytearray, np.random.Generator], bytearray]


def _region(content: bytearray, rng: np.random.Generator) -> tuple[int, int]:
    """First byte and end of a part of a file, of any size."""
    first = int(rng.integers(len(content)))
    length = int(2 ** rng.uniform(0, 14))
    return first, min(first + length, len(content))


def cut(content: bytearray, rng: np.random.Generator) -> bytearray:
    return content[: int(rng.integers(len(content)))]


def flipped(content: bytearray, rng: np.random.Generator) -> bytearray:
    for at in rng.integers(len(content), size=int(rng.integers(1, 5))).tolist():
        content[at] ^= 1 << int(rng.integers(8))
    return content


def zeroed(content: bytearray, rng: np.random.Generator) -> bytearray:
    first, end = _region(content, rng)
    content[first:end] = bytes(end - first)
    return content


def scrambled(content: bytearray, rng: np.random.Generator) -> bytearray:
    first, end = _region(content, rng)
    content[first:end] = rng.bytes(end - first)
    return content


def inserted(content: bytearray, rng: np.random.Generator) -> bytearray:
    first, end = _region(content, rng)
    content[first:first] = rng.bytes(end - first)
    return content


def deleted(content: bytearray, rng: np.random.Generator) -> bytearray:
    first, end = _region(content, rng)
    del content[first:end]
    return content


def duplicated(content: bytearray, rng: np.random.Generator) -> bytearray:
    first, end = _region(content, rng)
    content[end:end] = content[first:end]
    return content


def swapped(content: bytearray, rng: np.random.Generator) -> bytearray:
    (a, b), (c, d) = sorted((_region(content, rng), _region(content, rng)))
    c, d = max(b, c), max(b, d)
    return content[:a] + content[c:d] + content[b:c] + content[a:b] + content[d:]


def appended(content: bytearray, rng: np.random.Generator) -> bytearray:
    return content + rng.bytes(int(rng.integers(1, 2000)))


DAMAGES: tuple[Change, ...] = (
    cut,
    flipped,
    zeroed,
    scrambled,
    inserted,
    deleted,
    duplicated,
    swapped,
    appended,
)


@dataclass
class Tally:
    """What came of the copies, by kind of damage; `wrong` names each that broke a rule."""

    tries: Counter[str] = field(default_factory=Counter)
    whole_chunks: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)


def many_chunks(folder: Path) -> Path:
    """A short recording flushed after every message: a chunk each, as in a long run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hertzloop.recordings.writer, "_FLUSH_EVERY_S", -1.0)
        return record(folder / "whole.mcap", "sensors.bits=16")


def records(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Kind, first byte and end of every record of a whole file, to the one that ends the data."""
    kind, end = -1, 8
    while kind != Opcode.DATA_END:
        at, kind = end, content[end]
        end = at + 9 + int.from_bytes(content[at + 1 : at + 9], "little")
        yield kind, at, end


def chunks(content: bytes) -> list[tuple[int, list[bytes]]]:
    """Where every chunk of a whole file ends, in order, and the payloads in it."""
    ends = [end for kind, _, end in records(content) if kind == Opcode.CHUNK]
    read = StreamReader(io.BytesIO(content), emit_chunks=True).records
    inside = [breakup_chunk(record) for record in read if isinstance(record, Chunk)]
    payloads = [[m.data for m in one if isinstance(m, Message)] for one in inside]
    return list(zip(ends, payloads, strict=True))


def first_damage(damaged: bytes, content: bytes) -> int:
    """First byte at which a damaged file is not the whole one."""
    shorter = min(len(damaged), len(content))
    a, b = (np.frombuffer(one[:shorter], np.uint8) for one in (damaged, content))
    differing = np.flatnonzero(a != b)
    return int(differing[0]) if len(differing) else shorter


def scene_end(content: bytes) -> int:
    """Where the scene ends in a whole file."""
    return next(end for kind, _, end in records(content) if kind == Opcode.ATTACHMENT)


def _too_long(number: int, frame: FrameType | None) -> None:
    raise TimeoutError(f"more than {LONGEST_S} s")


def samples(recording: Recording) -> dict[tuple[str, str], bytes]:
    """Bytes of every array, by stream and field."""
    return {
        (name, label): values.tobytes()
        for name in SAMPLED
        for label, values in getattr(recording, name).arrays.items()
    }


def check_beginnings(kept: Recording, original: Recording) -> None:
    """Every array of a recording is the beginning of the original's."""
    whole = samples(original)
    for key, values in samples(kept).items():
        assert whole[key].startswith(values), key


def looked_at(path: Path, original: Recording, shown: bool) -> Recording | None:
    """What is done with a recording, through to what a person sees if it is `shown`; None
    if a sentence says that it is none. Raises AssertionError."""
    try:
        kept = read(path)
    except RecordingError as error:
        sentence = str(error)
        if str(path) not in sentence or "\n" in sentence:
            raise AssertionError(f"no sentence: {sentence}") from error
        return None
    if shown:
        found, text = inspected(kept), io.StringIO()
        print_inspection(Console(file=text, width=500), found)
        complete = not kept.problems
        assert ("Complete" in text.getvalue()) == inspection_as_json(found)["complete"] == complete
    same = first_difference(original, kept) is None
    assert same == (first_difference(kept, original) is None)
    if same:
        assert samples(kept) == samples(original), "said to be the same"
        assert sorted(map(repr, kept.events)) == sorted(map(repr, original.events))
    return kept


def repaired(path: Path, out: Path, kept: Recording) -> bool:
    """Whether something can be repaired; that keeps all that is read. Raises AssertionError."""
    try:
        repair(path, out, overwrite=True)
    except RecordingError as error:
        if "nothing to repair" not in str(error):
            raise AssertionError(f"not repaired: {error}") from error
        return False
    after = read(out)
    assert samples(after) == samples(kept)
    assert (after.events, after.ends) == (kept.events, kept.ends)
    assert not kept.problems or any("repaired from" in one for one in after.problems)
    return True


def try_one(path: Path, out: Path, original: Recording, shown: bool) -> list[bytes] | None:
    """Read and repair a damaged copy of `original` at `path`; the payloads that were read, None if
    a sentence says that it is no recording. Raises AssertionError."""
    kept = looked_at(path, original, shown)
    if kept is None:
        return None
    assert kept.problems, "said to be complete"
    assert kept.scene_toml == original.scene_toml
    check_beginnings(kept, original)
    if not repaired(path, out, kept):
        return []
    return [one for _, inside in chunks(out.read_bytes()) for one in inside]


Copies = Iterator[tuple[str, bytes]]  # a kind of damage, and a file


def drawn(content: bytes, tries: int, seed: int) -> Copies:
    """Damaged copies, every kind in turn."""
    for number in range(tries):
        change = DAMAGES[number % len(DAMAGES)]
        random = np.random.default_rng([seed, number])
        yield change.__name__, bytes(change(bytearray(content), random))


def try_many(source: Path, folder: Path, copies: Copies) -> Tally:
    """Try damaged copies of a recording."""
    content, original, tally = source.read_bytes(), read(source), Tally()
    parts, with_scene = chunks(content), scene_end(content)
    path, out = folder / "damaged.mcap", folder / "repaired.mcap"
    before = signal.signal(signal.SIGALRM, _too_long)
    try:
        for number, (kind, damaged) in enumerate(copies):
            if damaged == content:
                continue
            path.write_bytes(damaged)
            end = first_damage(damaged, content)
            whole = [payloads for at, payloads in parts if at <= end]
            tally.tries[kind] += 1
            signal.alarm(LONGEST_S)
            try:
                found = try_one(path, out, original, number % SHOWN == 0)
            except Exception as error:
                tally.wrong.append(f"{kind}, try {number}: {type(error).__name__}: {error}")
                continue
            finally:
                signal.alarm(0)
            if found is None:
                if end >= with_scene:
                    tally.wrong.append(f"{kind}, try {number}: no recording, with a scene")
                continue
            have = set(found)
            tally.whole_chunks[kind] += len(whole)
            if lost := sum(not have.issuperset(one) for one in whole):
                tally.wrong.append(f"{kind}, try {number}: {lost} chunks not read")
    finally:
        signal.signal(signal.SIGALRM, before)
    return tally


def main() -> int:
    """Exit code: 1 if a rule was broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tries", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=secrets.randbits(32))
    chosen = parser.parse_args()
    print(f"seed {chosen.seed}", flush=True)
    with tempfile.TemporaryDirectory() as name:
        source = many_chunks(Path(name))
        copies = drawn(source.read_bytes(), chosen.tries, chosen.seed)
        tally = try_many(source, Path(name), copies)
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    if most > MOST_BYTES:
        tally.wrong.append(f"it took {most / 2**30:.2f} GiB of memory")
    print(*tally.wrong, sep="\n")
    rows = [(kind, count, tally.whole_chunks[kind]) for kind, count in tally.tries.items()]
    print(markdown(("damage", "copies", "chunks before the damage"), rows))
    print(f"\n{tally.tries.total()} copies, {len(tally.wrong)} broke a rule")
    return bool(tally.wrong)


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        sys.exit(main())
