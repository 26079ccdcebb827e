"""The example controller on zenoh-pico: hellos that it has room for, and the page as it stands.

Its sources are the user's: PICO_SOURCES names a folder with the clones `zenoh-pico` and `nanopb`.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hertzloop.analysis.deflection import modes_of_scene
from hertzloop.bus.messages_pb2 import DaqBlock, LaneOffer, RunEnd, StreamCount
from hertzloop.bus.streams import PLANT, STREAMS
from hertzloop.bus.wire import encode
from hertzloop.controller.loading.registry import shipped as laws
from hertzloop.loop.compiled import record_in_process
from hertzloop.loop.plant_streams import hello
from hertzloop.plant.structures.mode_file import write_modes
from hertzloop.recordings.reader import read
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import shipped
from hertzloop.setup import load

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how-to" / "microcontroller.md").read_text()
WIRE = (ROOT / "docs" / "reference" / "wire.md").read_text()
ROOM = int(
    re.search(
        r"define MESSAGE_BYTES (\d+)", (ROOT / "docs/examples/pico_controller.c").read_text()
    )[1]
)  # type: ignore[index]


def test_hellos_of_all_shipped_scenes_and_laws_are_as_small_as_stated() -> None:
    offer = LaneOffer(host="a" * 32, pid=2**31, fd=1000)
    sizes = []
    for name in shipped():
        for law in laws():
            try:
                setup = load(name, [f"controller.law={law}"])
            except SceneError:  # the law senses something else
                continue
            said = hello(setup, setup.stiffness)
            said.run_id = 2**64 - 1
            said.lane.CopyFrom(offer)
            sizes.append(said.ByteSize())
    least, most = (
        int(x.replace(",", "")) for x in re.findall(r"\| `hello` \| (\S+) to (\S+) ", WIRE)[0]
    )
    assert len(sizes) > 50
    assert least - 20 < min(sizes) <= max(sizes) < most + 20  # versions of packages are part of it
    assert max(sizes) < ROOM < 4096


def test_hellos_with_files_are_as_large_as_stated(tmp_path: Path) -> None:
    modes, trace = tmp_path / "modes.npz", tmp_path / "trace.csv"
    modes.write_bytes(write_modes(".npz", modes_of_scene(load("aluminium-3mm"))))
    trace.write_text("\n".join(str(i % 7) for i in range(2000)))
    found = []
    for setting in (f"plate.modes={modes}", f"controller.latency_trace={trace}"):
        setup = load("aluminium-3mm", [setting])
        found.append(hello(setup, setup.stiffness).ByteSize())
    [stated] = re.findall(r"it has (\d+) kB, with 2,000 measured latencies\n(\d+) kB", WIRE)
    assert [round(size / 1000) for size in found] == [int(kilobytes) for kilobytes in stated]


def test_blocks_and_ends_are_as_small_as_stated() -> None:
    most = 2**63 - 1
    block = DaqBlock(run_id=most, sequence=most, first_step=most, step_ns=2**32 - 1,
                     every_steps=2**32 - 1, scale=1.0, offset=1.0)  # fmt: skip
    for samples in (1, 201, 10_000):
        assert len(encode(block, value=[1.0] * samples)) <= 64 + 8 * samples
        block.saturated = bytes(samples)
        assert len(encode(block, code=[1] * samples)) <= 64 + 5 * samples + 8
        block.saturated = b""
    assert len(encode(block, value=[1.0] * 201)) < ROOM
    end = RunEnd(run_id=most, role=PLANT)
    for stream in STREAMS.values():
        if stream.publisher == PLANT:
            end.count.append(StreamCount(stream=stream.name, messages=most, samples=most))
    assert end.ByteSize() <= 512


@pytest.mark.full
@pytest.mark.skipif("PICO_SOURCES" not in os.environ, reason="needs PICO_SOURCES")
@pytest.mark.skipif(not shutil.which("nanopb_generator"), reason="needs nanopb")
def test_the_page_as_it_stands(tmp_path: Path) -> None:
    for name in ("zenoh-pico", "nanopb"):
        (tmp_path / name).symlink_to(Path(os.environ["PICO_SOURCES"]) / name)
    shutil.copy(ROOT / "docs" / "examples" / "pico_controller.c", tmp_path)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    before = PAGE.partition("## TLS")[0]
    for block in re.findall(r"```\n(.*?)```", before, re.DOTALL):
        for line in block.splitlines():
            if line.startswith(("git clone", "pip install")):
                continue
            done = subprocess.run(
                line, shell=True, cwd=tmp_path, capture_output=True, text=True, timeout=600,
                env={**os.environ, "PATH": path},
            )  # fmt: skip
            assert done.returncode == 0, (line, done.stdout, done.stderr)
            assert "law test" not in line or "conforms: " in done.stdout
    ran = read(tmp_path / "aluminium-3mm.mcap")
    record_in_process(load("aluminium-3mm"), tmp_path / "shipped.mcap", compiled=True)
    forces = read(tmp_path / "shipped.mcap").force.arrays["force_n"]
    assert ran.force.arrays["force_n"].tobytes() == forces.tobytes()
