"""Roles that see each other do not give up while one of them still waits for another."""

import threading
import time
from pathlib import Path

import pytest

from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.loop.plant_node import PlantNode
from hertzloop.recordings.reader import read
from hertzloop.scene.setup import load
from tests.hertzloop.processes import finish, start
from tests.ports import free_ports

NAME, TIMEOUT_S = "late-start", 2.0


def _port(role: str, own: int, *others: int) -> ZenohPort:
    listen, *connect = (f"tcp/127.0.0.1:{number}" for number in (own, *others))
    return ZenohPort(role, NAME, [listen], connect)


def _serve(node: ControllerNode) -> None:
    while not node.done:
        node.work(60.0)


@pytest.mark.full
def test_a_run_that_begins_after_the_timeout(tmp_path: Path) -> None:
    path, (a, b, c) = tmp_path / "late.mcap", free_ports(3)
    words = ["--name", NAME, "--timeout", str(TIMEOUT_S), "--wait", "120", "--out", str(path)]
    connect = ["--connect", f"tcp/127.0.0.1:{a}", "--connect", f"tcp/127.0.0.1:{b}"]
    recorder = start("node", "recorder", *words, "--listen", f"tcp/127.0.0.1:{c}", *connect)
    ports = {PLANT: _port(PLANT, a), CONTROLLER: _port(CONTROLLER, b, a)}
    controller = ControllerNode(ports[CONTROLLER])
    for port in ports.values():
        port.liveliness.announce()
    for role, other in ((PLANT, CONTROLLER), (CONTROLLER, PLANT)):
        ports[role].liveliness.wait_for([other, RECORDER], 120.0)
    time.sleep(3 * TIMEOUT_S)  # the recorder sees both, the plant could still miss one
    thread = threading.Thread(target=_serve, args=(controller,))
    thread.start()
    PlantNode(load("aluminium-3mm", ["run.duration_s=0.002"]), ports[PLANT], timeout_s=60.0).run()
    thread.join(60)
    code, err, _ = finish(recorder)
    for port in ports.values():
        port.close()
    assert code == 0, err
    assert not read(path).problems
