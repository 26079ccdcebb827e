"""Strangers and doubles on the bus of real processes: no run goes on with what they say."""

import math
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hertzloop.bus import codec
from hertzloop.bus.codec import decoded
from hertzloop.bus.port import PeerLost
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, Envelope
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.loop.in_process import record_in_process
from hertzloop.recordings.reader import read
from hertzloop.recordings.recorder import Recorder
from tests.bus.meshes import stranger
from tests.commands import as_options
from tests.hertzloop.commands import EVENTUALLY_S, Bus, ended, wait_for
from tests.hertzloop.scenes import aluminium_3mm

SHORT = as_options(["run.duration_s=0.0025", "run.accuracy=0.1"])


class Foreign:
    """A controller of somebody else's in this process; `change` is what it makes of forces."""

    def __init__(self, bus: Bus, change: Callable[[Any, np.ndarray], np.ndarray]) -> None:
        self.port = ZenohPort(CONTROLLER, bus.name, [bus.urls[CONTROLLER]], [bus.urls[PLANT]])
        self.change = change
        self.role = CONTROLLER
        self.thread = threading.Thread(target=self._run)

    def publish(self, envelope: Envelope) -> None:
        """As the port of a node: changes what it says."""
        if envelope.stream == "force":
            block = decoded(envelope)
            force = self.change(block.header, block.arrays["force_n"].copy())
            envelope = Envelope("force", codec.encode(block.header, force_n=force))
        self.port.publish(envelope)

    def _run(self) -> None:
        node = ControllerNode(self)  # type: ignore[arg-type]
        try:
            self.port.liveliness.announce()
            self.port.liveliness.wait_for([PLANT, RECORDER], EVENTUALLY_S)
            while not node.done:
                node.handle(self.port.receive(EVENTUALLY_S, "samples"))
        except PeerLost:
            pass

    def __enter__(self) -> "Foreign":
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.thread.join(2 * EVENTUALLY_S)
        assert not self.thread.is_alive()
        self.port.close()


@pytest.mark.full
def test_a_fault_that_the_recorder_hears_first(tmp_path):
    """It waits until the others have heard it, too: they name the cause, not its departure."""
    bus = Bus("first-heard")
    heard: list[bytes] = []

    def change(header: Any, force: np.ndarray) -> np.ndarray:
        force[-1:] = math.inf
        if not heard:
            heard.append(codec.encode(header, force_n=force))
            publisher.put(heard[0])
            time.sleep(1.0)  # the link to the plant is slow
        return force

    recorder = bus.start(RECORDER, "--out", str(tmp_path / "a.mcap"))
    with stranger(bus.urls[RECORDER]) as mouth:
        publisher = mouth.declare_publisher(f"hertzloop/{bus.name}/force")
        wait_for(lambda: publisher.matching_status.matching)
        plant = bus.start(PLANT, "aluminium-3mm", *SHORT)
        with Foreign(bus, change):
            ended(plant, 1, "stream 'force' sequence", "holds force_n = inf")
            ended(recorder, 1, "holds force_n = inf")
    kept = read(tmp_path / "a.mcap")
    assert kept.result["complete"] == "no"
    assert "holds force_n" in kept.result["fault"]
    assert all(np.isfinite(values).all() for values in kept.truth.arrays.values())


def test_a_run_in_one_process_is_reconciled(tmp_path, monkeypatch):
    """Here nobody but the run itself can look at what the recorder heard."""
    honest = Recorder.handle

    def deaf(self: Recorder, envelope: Envelope) -> None:
        if envelope.stream != "balance":
            honest(self, envelope)

    monkeypatch.setattr(Recorder, "handle", deaf)
    scene = aluminium_3mm("run.duration_s=0.0015", "run.accuracy=0.1")
    for compiled in (False, True):
        path = tmp_path / f"{compiled}.mcap"
        with pytest.raises(Exception, match="stream 'balance' is incomplete"):
            record_in_process(scene, path, compiled=compiled)
        assert "stream 'balance' is incomplete" in read(path).result["fault"]
