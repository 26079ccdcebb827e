"""Ways in which a file is damaged, and ways in which a recording may lie with right checksums."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.descriptor import FieldDescriptor

from hertzloop.bus import codec
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingWriter
from tests.recordings.rewriting import Sent

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


_NUMBERS = (0, 1, 2, 7, 2**31 - 1, 2**31, 2**32 - 1, 2**53, 2**63 - 1, 2**63, 2**64 - 1)
_REALS = (0.0, -0.0, 1.0, -1e308, 1e308, 5e-324, float("inf"), float("-inf"), float("nan"))
_TEXTS = ("", "plant", "controller", "[red]", "x" * 5000, "9" * 5000, "a\nb", "\x00", "é" * 50)
_SCENES = (
    "",
    "= =",
    "[run]\nduration_s = 1e999",
    "a = " + "[" * 3000,
    "x = " + "9" * 5000,
    "[run]",
    "shows = 5",
    "run = 3",
    "[controller]\nlaw = 'none'",
    "run = [1]\nsphere = 'x'",
)


def _value(field: FieldDescriptor, rng: np.random.Generator) -> Any:
    """Anything that a field of this type can hold."""
    kinds = FieldDescriptor
    if field.name == "scene_toml":
        return str(rng.choice(_SCENES))
    if field.type == kinds.TYPE_STRING:
        return str(rng.choice(_TEXTS))
    if field.type == kinds.TYPE_BYTES:
        return rng.bytes(int(rng.integers(0, 3000)))
    if field.type in (kinds.TYPE_DOUBLE, kinds.TYPE_FLOAT):
        return float(rng.choice(_REALS))
    if field.type == kinds.TYPE_BOOL:
        return bool(rng.integers(2))
    value = int(_NUMBERS[rng.integers(len(_NUMBERS))])
    if field.cpp_type in (kinds.CPPTYPE_ENUM, kinds.CPPTYPE_INT32):
        return value % 2**31
    return value % (2**32 if field.cpp_type == kinds.CPPTYPE_UINT32 else 2**64)


def change_a_field(sent: Sent, rng: np.random.Generator) -> None:
    """Change one scalar field, or one array, of a message."""
    header = sent.header
    fields = [f for f in header.DESCRIPTOR.fields if not f.is_repeated]
    if hasattr(header, "timestamp") and rng.integers(3) == 0:
        header.timestamp.seconds = int(rng.choice([-1, -(2**40), 2**40, 253402300800, -(2**63)]))
        header.timestamp.nanos = int(rng.choice([0, -1, 2**31 - 1, 999_999_999]))
    elif getattr(header, "count", None) and rng.integers(2):
        count = header.count[int(rng.integers(len(header.count)))]
        field = count.DESCRIPTOR.fields[int(rng.integers(3))]
        setattr(count, field.name, _value(field, rng))
    elif sent.arrays and rng.integers(2):
        name = list(sent.arrays)[int(rng.integers(len(sent.arrays)))]
        kind = int(rng.integers(4))
        if kind == 0:
            del sent.arrays[name]
        elif kind == 1:
            sent.arrays[name] = sent.arrays[name][: int(rng.integers(len(sent.arrays[name])))]
        elif kind == 2 and sent.arrays[name].dtype.kind == "f":
            sent.arrays[name][rng.integers(len(sent.arrays[name]))] = rng.choice(_REALS)
        else:
            sent.arrays[name][rng.integers(len(sent.arrays[name])) :] = 0
    else:
        field = fields[int(rng.integers(len(fields)))]
        if field.type != FieldDescriptor.TYPE_MESSAGE:
            setattr(header, field.name, _value(field, rng))


def lying(original: list[Sent], source: Path, path: Path, rng: np.random.Generator) -> Path:
    """A recording with right checksums, and one to three things changed in it."""
    recording = read(source)
    scene, metadata, result = recording.scene_toml, recording.metadata, dict(recording.result)
    sent = [
        Sent(
            m.stream,
            m.number,
            m.time_ns,
            type(m.header).FromString(m.header.SerializeToString()),
            {n: a.copy() for n, a in m.arrays.items()},
        )
        for m in original
    ]
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(sent)))
        kind = int(rng.integers(10))
        if kind < 5:
            change_a_field(sent[at], rng)
        elif kind == 5:
            del sent[at]
        elif kind == 6:
            sent.insert(int(rng.integers(len(sent))), sent[at])
        elif kind == 7:
            sent[at].time_ns = int(rng.choice([0, 1, 2**62, 2**63 - 1]))
        elif kind == 8:
            scene = str(rng.choice(_SCENES)) or scene
        else:
            key = str(rng.choice(sorted(metadata)))
            metadata[key] = str(rng.choice([*_TEXTS, "-1", "1e3", "zz", str(2**70)]))
    writer = RecordingWriter(path, overwrite=True)
    writer.scene(scene, metadata)
    for m in sent:
        writer.write(m.stream, codec.encode(m.header, **m.arrays), m.number & 0xFFFFFFFF, m.time_ns)
    writer.finish(result)
    return path
