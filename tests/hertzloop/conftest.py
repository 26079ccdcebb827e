"""Fixtures of the tests of the lock-step."""

import pytest

from hertzloop.loop import plant_node


@pytest.fixture
def short_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """More blocks, more answers under way: the plant looks at them between two blocks."""
    monkeypatch.setattr(plant_node, "BLOCK_STEPS", 50)
