"""The example controller on zenoh-pico has room for the hello of every scene."""

import re

import pytest

from hertzloop.bus.messages_pb2 import SharedMemoryOffer
from hertzloop.controller.loading.registry import shipped as laws
from hertzloop.loop.announcement import hello
from hertzloop.plant.structures.mode_file import write_modes
from hertzloop.results.scene_modes import modes_of_scene
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import shipped
from hertzloop.scene.setup import load
from hertzloop.scene.toml import to_toml
from tests.hertzloop.own_laws import EXAMPLES, ROOT
from tests.hertzloop.scenes import aluminium_3mm

WIRE = (ROOT / "docs" / "reference" / "wire.md").read_text()
ROOM = int(
    re.search(r"define MESSAGE_BYTES (\d+)", (EXAMPLES / "pico_controller.c").read_text())[1]
)  # type: ignore[index]


def test_hellos_of_all_shipped_scenes_and_laws_are_as_small_as_stated():
    offer = SharedMemoryOffer(host="a" * 32, pid=2**31, fd=1000)
    sizes = []
    for name in shipped():
        for law in laws():
            try:
                setup = load(name, [f"controller.law={law}"])
            except SceneError:  # the law senses something else
                continue
            said = hello(setup, setup.law.stiffness)
            said.run_id = 2**64 - 1
            said.shared_memory.CopyFrom(offer)
            sizes.append(said.ByteSize())
    least, most = (
        int(x.replace(",", "")) for x in re.findall(r"- `hello`: (\S+) to (\S+) ", WIRE)[0]
    )
    assert len(sizes) > 50
    assert least - 20 < min(sizes) <= max(sizes) < most + 20  # versions of packages are part of it
    assert max(sizes) < ROOM < 4096


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
    assert all(hello(setup, setup.law.stiffness).ByteSize() < ROOM for setup in with_files)
    assert all(len(to_toml(setup.scene)) > ROOM for setup in with_files)
