"""What has to be compiled follows from the types of a scene's parts; who compiles is waited for."""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from numba.core import event

from hertzloop import warmup
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.controller.controller import Controller
from hertzloop.loop import controller_node
from hertzloop.loop.plant_node import PlantNode
from hertzloop.processes.roles import BusAddress, run_controller, run_recorder
from hertzloop.recordings.reader import read
from hertzloop.scene.controller import build_controller
from hertzloop.scene.setup import Setup, load
from tests.bus.meshes import PATIENCE_S, url
from tests.hertzloop.short_runs import scene
from tests.ports import free_ports

COARSE = ["run.duration_s=0.0025", "run.accuracy=0.1"]
# Kernels are compiled for each of these kinds of plant.
KINDS = {
    "ideal": [],
    "actuator": ["plate.edges=cccc", "actuator.bandwidth_hz=5e4", "actuator.mass_kg=0.002"],
    "spring": ["plate.tail=spring"],
    "air": ["plate.radiation=one_face"],
    "yields": ["contact.plasticity=thornton"],
    "infinite": ["run.plate_model=infinite"],
    "scheme": ["run.scheme=thesis2008"],
}


@pytest.fixture
def ran(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Setup]:
    """The scenes that were run to compile their kernels, from an empty folder on."""
    found: list[Setup] = []
    monkeypatch.setattr(warmup, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(warmup, "_run", lambda scene, folder: found.append(scene))
    monkeypatch.setattr(warmup, "_compile_at_once", lambda scene, tell: tell(0.5, "all of it"))
    return found


def test_each_kind_of_plant_is_compiled_once(ran: list[Setup]) -> None:
    told: list[float] = []
    assert not warmup.anything_compiled()
    for settings in KINDS.values():
        scene = load("aluminium-3mm", [*COARSE, *settings])
        assert not warmup.all_compiled(scene)
        warmup.ensure_compiled(scene, on_progress=lambda share, what: told.append(share))
        assert warmup.all_compiled(scene)
    assert told == [0.5] * len(KINDS)
    assert warmup.anything_compiled()
    for more in (["sensors.bits=10"], ["controller.law=off"], ["plate.thickness_m=0.004"]):
        assert warmup.all_compiled(load("aluminium-3mm", [*COARSE, *more]))
    assert [one.law_reference for one in ran] == ["off"] * len(KINDS)
    assert all(one.duration_s < 0.0025 for one in ran)


SCRIPT = """
import sys
from pathlib import Path
from hertzloop import warmup
from hertzloop.warmup import ensure_compiled
from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.scene.setup import load
from hertzloop.scene.controller import build_controller
from hertzloop.common.jit.progress import report_compiling

# An infinite plate of which the full model is too large to be timed: little to compile.
scene = load("aluminium-3mm", ["run.plate_model=infinite", "plate.size_m=[3.0, 3.0]",
    "plate.contact_point_m=[1.5, 1.5]", "run.duration_s=0.0012", "run.accuracy=0.1"])
told, run = [], warmup._run
def noticed_run(scene, folder):
    with report_compiling(told.append):
        run(scene, folder)
warmup._run = noticed_run
ensure_compiled(scene)
print(told)  # all is compiled at once
build_controller(scene)  # its law
told = []
with report_compiling(told.append):
    for transport in (Transport.COMPILED, Transport.INPROCESS):
        run_and_assess(scene, Path(sys.argv[1]) / f"{transport}.mcap", RunOptions(transport))
print(told)
"""


@pytest.mark.full
def test_a_run_of_a_compiled_scene_compiles_nothing(tmp_path: Path) -> None:
    """From an empty cache."""
    (tmp_path / "cache").mkdir()
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path)],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
    )
    assert done.stdout.split() == ["[]", "[]"], done.stderr


@pytest.mark.full
def test_a_controller_that_compiles_its_law_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes three times as long as the others wait for anything else."""
    timeout_s, urls, path = 2.0, [url(port) for port in free_ports(3)], tmp_path / "run.mcap"
    build = build_controller

    def compiled_long(*arguments: Any) -> Controller:
        with event.trigger_event("numba:compile"):
            time.sleep(3 * timeout_s)
        return build(*arguments)

    monkeypatch.setattr(controller_node, "build_controller", compiled_long)

    def address(place: int) -> BusAddress:
        return BusAddress(
            "slow", urls[place : place + 1], urls[:place], None, timeout_s, PATIENCE_S
        )

    plant = ZenohPort(PLANT, "slow", urls[:1])
    with ThreadPoolExecutor(2) as others:
        controller = others.submit(run_controller, address(1))
        recorder = others.submit(run_recorder, path, address(2))
        try:
            node = PlantNode(scene(), plant, timeout_s=timeout_s)
            plant.liveliness.announce()
            plant.liveliness.wait_for([CONTROLLER, RECORDER], PATIENCE_S)
            node.run()
            plant.liveliness.wait_for_completion(RECORDER, PATIENCE_S)
        finally:
            plant.close()
        controller.result(PATIENCE_S)
        recorder.result(PATIENCE_S)
    assert not read(path).problems


LEAN = """
import sys
from hertzloop.results.metrics import free_metrics
from hertzloop.loop.simulate import simulate
from hertzloop.scene.setup import load
setup = load("aluminium-20mm", ["run.duration_s=0.003"])
assert simulate(setup).truth.any()
assert free_metrics(setup).impacts
late = ("numba.np.linalg", "scipy.linalg", "scipy.special")
print([name for name in late if name in sys.modules])
"""


@pytest.mark.usefixtures("warm_kernels")
def test_a_run_loads_neither_the_compiler_nor_scipy() -> None:
    """Kernels that are in the cache need neither: together they take a third of a second."""
    done = subprocess.run(
        [sys.executable, "-c", LEAN], capture_output=True, text=True, timeout=120.0
    )
    assert (done.returncode, done.stdout.strip()) == (0, "[]"), done.stderr
