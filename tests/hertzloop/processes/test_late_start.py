"""Roles that see each other do not give up while one of them still waits for another."""

import threading
import time

import pytest

from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.loop.plant_node import ExchangeOptions, PlantNode
from hertzloop.recordings.reader import read
from tests.hertzloop.commands import Bus, ended
from tests.hertzloop.scenes import aluminium_3mm

TIMEOUT_S = 2.0


def _serve(node: ControllerNode) -> None:
    while not node.done:
        node.work(60.0)


@pytest.mark.full
def test_a_run_that_begins_after_the_timeout(tmp_path):
    path, bus = tmp_path / "late.mcap", Bus("late-start")
    recorder = bus.start(RECORDER, "--timeout", str(TIMEOUT_S), "--out", str(path))
    ports = {
        PLANT: ZenohPort(PLANT, bus.name, [bus.urls[PLANT]], []),
        CONTROLLER: ZenohPort(CONTROLLER, bus.name, [bus.urls[CONTROLLER]], [bus.urls[PLANT]]),
    }
    controller = ControllerNode(ports[CONTROLLER])
    for port in ports.values():
        port.liveliness.announce()
    for role, other in ((PLANT, CONTROLLER), (CONTROLLER, PLANT)):
        ports[role].liveliness.wait_for([other, RECORDER], 120.0)
    time.sleep(3 * TIMEOUT_S)  # the recorder sees both, the plant could still miss one
    thread = threading.Thread(target=_serve, args=(controller,))
    thread.start()
    scene = aluminium_3mm("run.duration_s=0.002")
    PlantNode(scene, ports[PLANT], ExchangeOptions(timeout_s=60.0)).run()
    thread.join(60)
    ended(recorder)
    for port in ports.values():
        port.close()
    assert not read(path).problems
