"""The lock-step under any delays: the same bytes."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from hertzloop.bus.messages_pb2 import ForceBlock
from hertzloop.bus.port import Port, Publisher
from hertzloop.bus.sequence_checker import SequenceChecker
from hertzloop.bus.streams import Envelope
from hertzloop.loop import plant_streams
from hertzloop.loop.announcement import controller_report
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.scene.setup import parse
from tests.hertzloop.exchange import exchange
from tests.hertzloop.short_runs import SCENES, scene
from tests.tiers import default

pytestmark = pytest.mark.usefixtures("short_blocks")

SEEDS = {"quick": range(30), "rest": range(30, 60)}  # of every scene


class Clock:
    """Goes on by a time of its own at every look; where blocks end is what it says."""

    def __init__(self, tick_s: Callable[[], float]) -> None:
        self._tick_s, self._now_s = tick_s, 0.0

    def monotonic(self) -> float:
        self._now_s += self._tick_s()
        return self._now_s


@cache
def expected(name: str) -> dict[str, str]:
    return exchange(scene(name), 0, max_exchange_steps=1).heard.samples()


@pytest.mark.parametrize("seeds", default(SEEDS, ["quick"]))
@pytest.mark.parametrize("name", default(SCENES, ["converters"]))
def test_the_same_bytes_under_any_delays(name, seeds, monkeypatch):
    monkeypatch.setattr(plant_streams, "ROOM_STEPS", 500)
    ways = set()
    for seed in SEEDS[seeds]:
        draw = np.random.default_rng([seed, 2])
        monkeypatch.setattr(plant_streams, "time", Clock(lambda draw=draw: draw.uniform(0.0, 0.02)))
        links = exchange(scene(name), seed, every_s=0.01, **way(seed))
        assert links.heard.samples() == expected(name), f"seed {seed}"
        assert not links.fault
        assert not links.recorder_fault
        ways.add(tuple(links.heard.order))
    assert len(ways) > 0.9 * len(SEEDS[seeds])  # hardly two of them alike


@pytest.mark.parametrize(("tick_s", "blocks"), [(0.0, 6), (1.0, 50)])
def test_blocks_are_as_long_as_there_is_time(tick_s, blocks, monkeypatch):
    """2500 steps: by room alone but for the first 50, or whenever there may be one."""
    monkeypatch.setattr(plant_streams, "ROOM_STEPS", 500)
    monkeypatch.setattr(plant_streams, "time", Clock(lambda: tick_s))
    assert exchange(scene("law"), 0, every_s=0.01).heard.order.count("truth") == blocks


def way(seed: int) -> dict[str, Any]:
    """Horizon and looking ahead of a schedule: half of them with what is usual."""
    draw = np.random.default_rng([seed, 1])
    return {
        "max_exchange_steps": None if seed % 2 else int(draw.integers(10, 500)),
        "controller": lambda port: ControllerNode(port, commands_ahead=seed % 4 < 3),
    }


class Hesitant:
    """An honest controller whose level rises: it pushes late by the scene's latency for every
    sample at or below zero, after the first of them for every one up to NEAR_M."""

    NEAR_M = 3e-5

    def __init__(self, port: Port) -> None:
        self.port, self.done = port, False
        self.checker = SequenceChecker(role="controller")

    def handle(self, envelope: Envelope) -> None:
        block = self.checker.accept(envelope)
        if envelope.stream == "hello":
            self.scene, self.hello = parse(block.header.scene_toml), block.header
            self.late = 1 + self.scene.signal_path.latency_steps
            self.publisher = Publisher(self.port, block.header.run_id)
            self.forces, self.level, self.seen, self.said = (
                np.zeros(self.scene.run.steps),
                0.0,
                0,
                0,
            )
        elif envelope.stream == "daq":
            self._answer(block.arrays["value"])
        elif envelope.stream == "end/plant":
            self.done = True

    def _answer(self, values: np.ndarray) -> None:
        for value in values:
            if value <= self.level:
                self.forces[self.seen + self.late : self.seen + self.late + 1] = 1.0
                self.level = self.NEAR_M
            self.seen += 1
        end = min(self.seen + self.late, self.scene.run.steps)
        header = ForceBlock(
            first_step=self.said,
            step_ns=1000,
            samples_seen=self.seen,
            zero_until_trigger=True,
            trigger_level=self.level,
        )
        self.publisher.send("force", header, {"force_n": self.forces[self.said : end]})
        self.said = end
        if self.seen == self.scene.run.steps:
            self.publisher.end(report=controller_report(self.scene))

    def fail(self, sentence: str) -> None:
        raise AssertionError(sentence)


@pytest.mark.full
def test_a_level_that_changes_is_believed_once_all_samples_were_seen():
    found = [
        exchange(scene("rising"), seed, controller=Hesitant, max_exchange_steps=None if seed else 1)
        for seed in SEEDS["quick"]
    ]
    for seed, links in enumerate(found):
        assert links.heard.samples() == found[0].heard.samples(), f"seed {seed}"
