"""Roles on a real bus: who waits for whom, and what a recorder confirms."""

import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hertzloop.bus.liveliness import Liveliness
from hertzloop.bus.port import PeerLost
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, Envelope
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.controller.controller import Controller
from hertzloop.loop import controller_node
from hertzloop.loop.plant_node import LoopStats, PlantNode
from hertzloop.loop.run_options import RunOptions
from hertzloop.processes.roles import BusAddress, run_controller, run_plant, run_recorder
from hertzloop.recordings.reader import read
from hertzloop.scene.controller import build_controller
from tests.bus.meshes import ABSENCE_S, PATIENCE_S, url
from tests.bus.tapes import controller_says, plant_says
from tests.ports import free_ports
from tests.recordings.rewriting import scene


@contextmanager
def recording(path: Path) -> Iterator[tuple[Future, ZenohPort, ZenohPort]]:
    """A recorder on a bus, and the ports of plant and controller, which see it."""
    urls = [url(port) for port in free_ports(3)]
    address = BusAddress(listen=urls[2:], connect=urls[:2], wait_s=PATIENCE_S)
    options = RunOptions(name="tapes", timeout_s=PATIENCE_S)
    ports = ZenohPort(PLANT, "tapes", urls[:1]), ZenohPort(CONTROLLER, "tapes", urls[1:2])
    with ThreadPoolExecutor(1) as other:
        ended = other.submit(run_recorder, path, address, options)
        try:
            for port in ports:
                port.liveliness.announce()
                port.liveliness.wait_for([RECORDER], PATIENCE_S)
            yield ended, *ports
        finally:
            ended.exception(PATIENCE_S)
            for port in ports:
                port.close()


def recorded(path: Path, plant: list[Envelope], controller: list[Envelope]) -> Future:
    """Play both on a bus to a recorder; how that ended. Raises PeerLost if it does not confirm."""
    with recording(path) as (ended, *ports):
        for port, said in zip(ports, (plant, controller), strict=True):
            for envelope in said:
                port.publish(envelope)
        ports[0].liveliness.wait_for_completion(RECORDER, PATIENCE_S)
    return ended


@pytest.mark.parametrize("stream", ["balance", "truth"])
def test_what_was_announced_and_did_not_come_fails_the_run(tmp_path, stream):
    """The last message of a stream: no later one shows that it lacks."""
    path = tmp_path / "a.mcap"
    said = plant_says()
    last = max(i for i, envelope in enumerate(said) if envelope.stream == stream)
    with pytest.raises(PeerLost, match="recorder left the run before its part was complete"):
        recorded(path, said[:last] + said[last + 1 :], controller_says())
    assert f"stream '{stream}' is incomplete" in read(path).result["fault"]


def run_over_zenoh(path: Path, name: str, timeout_s: float = PATIENCE_S) -> list[Future]:
    """A run of the three roles; how plant and controller ended."""
    urls = [url(port) for port in free_ports(3)]
    plant, controller, recorder = (
        BusAddress(listen=[at], connect=urls[:place], wait_s=PATIENCE_S)
        for place, at in enumerate(urls)
    )
    options = RunOptions(name=name, timeout_s=timeout_s)
    with ThreadPoolExecutor(3) as roles:
        others = [
            roles.submit(run_plant, scene(), plant, options),
            roles.submit(run_controller, controller, options),
        ]
        roles.submit(run_recorder, path, recorder, options).result()
    return others


def test_plant_and_controller_fail_where_the_recorder_does_not_confirm(tmp_path, monkeypatch):
    """All was sent and answered: without the recorder's word nobody knows that it was kept."""
    monkeypatch.setattr(Liveliness, "confirm_completion", lambda _: None)
    for role in run_over_zenoh(tmp_path / "a.mcap", "unconfirmed"):
        with pytest.raises(PeerLost, match="recorder left the run before its part was compl"):
            role.result()


def test_the_plant_leaves_last(tmp_path, monkeypatch):
    """A controller that is slow to hear the plant's end does not miss the plant before."""
    leave, order = ZenohPort.close, list[str]()

    def close(port: ZenohPort) -> None:
        if port.role == CONTROLLER:
            time.sleep(ABSENCE_S)
        order.append(port.role)
        leave(port)

    monkeypatch.setattr(ZenohPort, "close", close)
    for role in run_over_zenoh(tmp_path / "a.mcap", "in-order"):
        role.result()
    assert order == [RECORDER, CONTROLLER, PLANT]


@pytest.mark.full
def test_before_the_first_force_all_are_waited_for(tmp_path, monkeypatch):
    """A plant that begins late, since it could still miss somebody, and a controller that compiles
    its law: each takes longer than the others wait for anything else."""
    timeout_s, begin = 2.0, PlantNode.run

    def begun_late(node: PlantNode) -> LoopStats:
        time.sleep(2.0 * timeout_s)
        return begin(node)

    def compiled_long(*arguments: Any) -> Controller:
        time.sleep(2.0 * timeout_s)
        return build_controller(*arguments)

    monkeypatch.setattr(PlantNode, "run", begun_late)
    monkeypatch.setattr(controller_node, "build_controller", compiled_long)
    for role in run_over_zenoh(tmp_path / "a.mcap", "slow", timeout_s):
        role.result()
    assert not read(tmp_path / "a.mcap").problems
