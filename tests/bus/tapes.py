"""Runs on tape: what plant and controller publish in a short, made-up run."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import (
    ControllerReport,
    DaqBlock,
    EnergyBalance,
    Event,
    ForceBlock,
    Hello,
    TruthBlock,
)
from hertzloop.bus.port import Publisher
from hertzloop.bus.streams import CONTROLLER, PLANT, STREAMS, Envelope

RUN = 0xABC
SCENE = "# made up\nkappa = 0.8"


class Tape:
    """Port that keeps what is published."""

    def __init__(self, role: str) -> None:
        self.role = role
        self.sent: list[Envelope] = []

    def publish(self, envelope: Envelope) -> None:
        self.sent.append(envelope)

    def receive(self, timeout_s: float, awaited: str, senders: Collection[str] = ()) -> Envelope:
        raise NotImplementedError

    def pending(self) -> bool:
        return False

    def close(self) -> None:
        pass


def plant_says(blocks: int = 3, every_steps: int = 1) -> list[Envelope]:
    """A short run as the plant publishes it: 4 samples and 4 * every_steps rows a block."""
    tape = Tape(PLANT)
    publisher = Publisher(tape, RUN)
    publisher.send(
        "hello",
        Hello(scene="made-up", scene_toml=SCENE, steps=4 * every_steps * blocks, step_ns=1000),
    )
    for i in range(blocks):
        step = 4 * every_steps * i
        daq = DaqBlock(first_step=step, step_ns=1000, every_steps=every_steps, scale=0.5)
        daq.saturated = bytes(4)
        publisher.send("daq", daq, {"code": np.arange(4)})
        rows = np.zeros(4 * every_steps)
        publisher.send("truth", TruthBlock(first_step=step, step_ns=1000), {"xi_m": rows})
        publisher.send("events/plant", Event(name="plant", message=f"event {i}"))
    publisher.send("balance", EnergyBalance(kinetic_j=1.0))
    publisher.end()
    return tape.sent


def places(sent: Sequence[Envelope], stream: str) -> list[int]:
    return [i for i, envelope in enumerate(sent) if envelope.stream == stream]


def changed(envelope: Envelope, **fields: Any) -> Envelope:
    """The same message with some header fields changed."""
    block = codec.decode(STREAMS[envelope.stream].message, envelope.payload)
    for name, value in fields.items():
        setattr(block.header, name, value)
    return replace(envelope, payload=codec.encode(block.header, **block.arrays))


def controller_says(blocks: int = 3) -> list[Envelope]:
    """The answer to `plant_says` with a sample every step."""
    tape = Tape(CONTROLLER)
    publisher = Publisher(tape, RUN)
    for i in range(blocks):
        force = ForceBlock(first_step=4 * i, step_ns=1000, samples_seen=4 * (i + 1))
        publisher.send("force", force, {"force_n": np.ones(4)})
        publisher.send("events/controller", Event(message=f"mode {i}"))
    publisher.end(report=ControllerReport(scene_toml=SCENE))
    return tape.sent
