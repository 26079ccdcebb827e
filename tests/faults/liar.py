"""A role of a run that once says something else than it should.

`python -m tests.faults.liar HOW STREAM NUMBER node plant ...` is `hertzloop node plant ...`, and
does HOW, one of `LIES`, to message NUMBER of STREAM. It prints `LIED` when it does.
"""

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hertzloop.__main__ import main
from hertzloop.bus import codec
from hertzloop.bus.codec import DecodedBlock, decoded
from hertzloop.bus.streams import Envelope
from hertzloop.bus.zenoh_port import ZenohPort

LIED = "a wrong message was sent"
_LARGE = 1 << 25  # bytes

Lie = Callable[[Envelope], list[Envelope]]


def _payload(change: Callable[[bytes], bytes]) -> Lie:
    return lambda envelope: [replace(envelope, payload=change(envelope.payload))]


def _message(change: Callable[[DecodedBlock], object]) -> Lie:
    def lie(envelope: Envelope) -> list[Envelope]:
        header, arrays = decoded(envelope)
        block = DecodedBlock(header, {name: values.copy() for name, values in arrays.items()})
        change(block)
        return [replace(envelope, payload=codec.encode(block.header, **block.arrays))]

    return lie


def _field(name: str) -> Lie:
    """One more in a field of the header, or of its first count."""

    def more(block: DecodedBlock) -> None:
        said = block.header.count[0] if name in ("messages", "samples") else block.header
        setattr(said, name, getattr(said, name) + 1)

    return _message(more)


def _not_finite(block: DecodedBlock) -> None:
    for values in block.arrays.values():
        if values.dtype.kind == "f":
            values[:1] = np.inf


def _other_scene(block: DecodedBlock) -> None:
    said = getattr(block.header, "report", block.header)
    said.scene_toml = said.scene_toml.replace("kappa", "lambda")


def _other_law(block: DecodedBlock) -> None:
    block.header.law_digest = "0" * 64


LIES: dict[str, Lie] = {
    "lost": lambda envelope: [],
    "repeated": lambda envelope: [envelope, envelope],
    "reordered": lambda envelope: [],  # and sent after the next one
    "cut": _payload(lambda payload: payload[: len(payload) // 2]),
    "random": _payload(lambda payload: np.random.default_rng(len(payload)).bytes(len(payload))),
    "too large": _payload(lambda payload: payload + bytes(_LARGE)),
    "not finite": _message(_not_finite),
    "other scene": _message(_other_scene),
    "other law": _message(_other_law),
    "number": lambda envelope: [replace(envelope, sequence=(envelope.sequence or 0) + 1)],
    **{
        name: _field(name)
        for name in (
            *("run_id", "sequence", "first_step", "step_ns", "samples_seen"),
            *("messages", "samples"),
        )
    },
}


def lie(how: str, stream: str, number: int) -> None:
    """Let the ports of this process do that from now on."""
    honest, came, kept = ZenohPort.publish, 0, list[Envelope]()

    def publish(self: ZenohPort, envelope: Envelope) -> None:
        nonlocal came
        said = [envelope]
        if envelope.stream == stream:
            if came == number:
                print(LIED, file=sys.stderr, flush=True)
                said = LIES[how](envelope)
                kept.extend([envelope] * (how == "reordered"))
            elif kept:
                said.append(kept.pop())
            came += 1
        for one in said:
            honest(self, one)

    ZenohPort.publish = publish  # type: ignore[method-assign]


if __name__ == "__main__":
    how, stream, number = sys.argv[1:4]
    del sys.argv[1:4]
    lie(how, stream, int(number))
    main()
