"""The example controller on zenoh-pico has room for the hello of every scene."""

import re

import pytest

from hertzloop.loop.announcement import hello
from hertzloop.plant.structures.mode_file import write_modes
from hertzloop.results.scene_modes import modes_of_scene
from hertzloop.scene.loading import shipped
from hertzloop.scene.setup import load
from hertzloop.scene.toml import to_toml
from tests.hertzloop.own_laws import EXAMPLES
from tests.hertzloop.scenes import aluminium_3mm

ROOM = int(
    re.search(r"define MESSAGE_BYTES (\d+)", (EXAMPLES / "pico_controller.c").read_text())[1]
)  # type: ignore[index]


@pytest.mark.parametrize("name", shipped())
def test_the_hello_of_a_shipped_scene_is_small(name):
    setup = load(name)
    assert hello(setup, setup.law_context.stiffness).ByteSize() < ROOM - 100 < 4096


@pytest.fixture(scope="module")
def with_files(tmp_path_factory):
    """A scene on a file of modes, and one with a file of latencies."""
    folder = tmp_path_factory.mktemp("files")
    modes, trace = folder / "modes.npz", folder / "trace.csv"
    modes.write_bytes(write_modes(".npz", modes_of_scene(aluminium_3mm())))
    trace.write_text("\n".join(str(i % 7) for i in range(2000)))
    settings = (f"plate.modes={modes}", f"controller.latency_trace={trace}")
    return [aluminium_3mm(setting).with_steps(1500) for setting in settings]


def test_the_hello_of_a_scene_with_files_is_small(with_files):
    assert all(hello(setup, setup.law_context.stiffness).ByteSize() < ROOM for setup in with_files)
    assert all(len(to_toml(setup.scene)) > ROOM for setup in with_files)
