"""The lock-step under any delays: the same bytes."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from hertzloop.loop import plant_streams
from hertzloop.loop.controller_node import ControllerNode
from tests.hertzloop.exchange import exchange
from tests.hertzloop.short_runs import SCENES, scene
from tests.tiers import default

pytestmark = pytest.mark.usefixtures("short_blocks")

SEEDS = range(30)  # of every scene


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


@pytest.mark.parametrize("name", default(SCENES, ["converters", "late"]))
def test_the_same_bytes_under_any_delays(name, monkeypatch):
    monkeypatch.setattr(plant_streams, "ROOM_STEPS", 500)
    ways = set()
    for seed in SEEDS:
        draw = np.random.default_rng([seed, 2])
        monkeypatch.setattr(plant_streams, "time", Clock(lambda draw=draw: draw.uniform(0.0, 0.02)))
        links = exchange(scene(name), seed, every_s=0.01, **way(seed))
        assert links.heard.samples() == expected(name), f"seed {seed}"
        assert not links.fault
        assert not links.recorder_fault
        ways.add(tuple(links.heard.order))
    assert len(ways) > 0.9 * len(SEEDS)  # hardly two of them alike


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
