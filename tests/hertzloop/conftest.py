"""Fixtures of the tests of the lock-step."""

import pytest

from hertzloop.loop import plant_streams


@pytest.fixture
def short_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """More blocks, more answers under way: the plant looks at them between two blocks."""
    monkeypatch.setattr(plant_streams, "BLOCK_STEPS", 50)
    monkeypatch.setattr(plant_streams, "ROOM_STEPS", 50)


@pytest.fixture(scope="session", autouse=True)
def warm(warm_kernels: None) -> None:
    """Processes of these tests start at once, also where this is the first test of all."""
