"""Fixtures of the tests of the lock-step."""

import shutil

import pytest

from hertzloop.loop import plant_streams
from tests.hertzloop.commands import python
from tests.hertzloop.own_laws import ROOT


@pytest.fixture
def short_blocks(monkeypatch):
    """More blocks, more answers under way: the plant looks at them between two blocks."""
    monkeypatch.setattr(plant_streams, "BLOCK_STEPS", 50)
    monkeypatch.setattr(plant_streams, "ROOM_STEPS", 50)


@pytest.fixture(scope="session", autouse=True)
def warm(warm_kernels):
    """Processes of these tests start at once, also where this is the first test of all."""


@pytest.fixture(scope="session")
def messages(tmp_path_factory):
    """A folder with the messages as the examples of controllers import them."""
    folder = tmp_path_factory.mktemp("messages")
    shutil.copy(ROOT / "bus" / "messages.proto", folder)
    python("-m", "grpc_tools.protoc", "-I.", "--python_out=.", "messages.proto", cwd=folder)
    return folder


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The working folder: it holds nothing, and processes that start in it find hertzloop."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return tmp_path
