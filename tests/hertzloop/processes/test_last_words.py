"""Who gives up says why to whoever is left, over zenoh, before it leaves."""

import math
import threading
import time
from contextlib import suppress

import pytest

from hertzloop.bus.codec import decoded
from hertzloop.bus.port import PeerLost
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, Envelope
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.loop.plant_node import PlantNode
from hertzloop.loop.run_options import RunOptions
from tests.bus.meshes import ABSENCE_S, PATIENCE_S, zenoh_mesh
from tests.hertzloop.commands import EVENTUALLY_S, wait_for
from tests.hertzloop.short_runs import scene


@pytest.fixture
def mesh():
    with zenoh_mesh("last-words") as ports:
        yield ports


def heard_last(port: ZenohPort) -> Envelope:
    """The last message that comes; those that left are no message."""
    found: list[Envelope] = []
    deadline = time.monotonic() + PATIENCE_S
    while not (found and found[-1].stream.startswith("end/")):
        assert time.monotonic() < deadline, found
        with suppress(PeerLost):
            found.append(port.receive(ABSENCE_S, "more"))
    return found[-1]


def test_a_plant_without_a_recorder_tells_the_controller(mesh):
    """What it cannot send any more does not keep it from its last words."""
    node = PlantNode(scene(), mesh[PLANT], RunOptions(timeout_s=PATIENCE_S))
    mesh[RECORDER].close()
    assert mesh[PLANT].liveliness.wait_until_gone(RECORDER, PATIENCE_S)
    wait_for(mesh[PLANT].pending)  # until it is missed
    with pytest.raises(PeerLost, match="recorder left the run; plant was sending 'hello'"):
        node.run()
    last = heard_last(mesh[CONTROLLER])
    assert last.stream == "end/plant"
    assert "recorder left the run; plant was sending 'hello'" in decoded(last).header.fault


def test_it_stays_until_they_have_heard(mesh):
    """Until each has left, or has said its own last words; a recorder says none."""
    over = threading.Event()

    def leave() -> None:
        mesh[PLANT].liveliness.wait_until_heard(PATIENCE_S)
        over.set()

    waiting = threading.Thread(target=leave)
    waiting.start()
    mesh[RECORDER].close()
    assert not over.wait(ABSENCE_S)
    mesh[PLANT].liveliness.wait_until_heard(math.inf, besides=[CONTROLLER])  # nobody else is there
    mesh[CONTROLLER].publish(Envelope("end/controller", b"", 0))
    assert over.wait(PATIENCE_S / 2)
    waiting.join(EVENTUALLY_S)
    assert not waiting.is_alive()
