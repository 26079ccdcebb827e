"""Plant and controller in two threads, with shared memory between them and queues for a bus."""

import queue
import threading
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path

from hertzloop.bus.codec import decoded
from hertzloop.bus.port import BusError, PeerLost
from hertzloop.bus.streams import CONTROLLER, PLANT, SUBSCRIPTIONS, Envelope, StreamFault
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.loop.plant_node import LoopStats, PlantNode
from hertzloop.loop.repeated_run import RepeatedRun
from hertzloop.loop.run_options import RunOptions
from hertzloop.recordings.reader import read
from hertzloop.recordings.recorder import Recorder
from hertzloop.recordings.recording import Recording
from hertzloop.scene.controller import build_controller
from hertzloop.scene.setup import Setup
from tests.hertzloop.commands import EVENTUALLY_S
from tests.hertzloop.exchange import Heard


class QueuePort:
    """Port of one role; `heard` gets what a recorder would."""

    def __init__(self, role: str, heard: list[Envelope]) -> None:
        self.role, self.heard, self.other = role, heard, self
        self.inbox: queue.SimpleQueue[Envelope] = queue.SimpleQueue()
        self.alter: Callable[[Envelope], Envelope] = lambda envelope: envelope

    def publish(self, envelope: Envelope) -> None:
        self.heard.append(envelope)
        if envelope.stream in SUBSCRIPTIONS[self.other.role]:
            self.other.inbox.put(self.alter(envelope))

    def receive(self, timeout_s: float, awaited: str, senders: Collection[str] = ()) -> Envelope:
        try:
            return self.inbox.get(timeout=timeout_s)
        except queue.Empty:
            raise PeerLost(f"{self.role} waited {timeout_s:g} s for {awaited}") from None

    def pending(self) -> bool:
        return not self.inbox.empty()

    def close(self) -> None:
        pass


@dataclass
class Pair:
    """A run of both; `fault` and `controller_fault` are what they said against it."""

    scene: Setup
    timeout_s: float = EVENTUALLY_S
    shared_memory: bool = True
    takes_lane: bool = True
    pace: float | None = None
    repeat: RepeatedRun | None = None
    heard: list[Envelope] = field(default_factory=list)
    fault: str = ""
    controller_fault: str = ""
    stats: LoopStats | None = None

    def __post_init__(self) -> None:
        build_controller(self.scene)  # compiles the law: some tests wait for 2 s
        self.ports = {role: QueuePort(role, self.heard) for role in (PLANT, CONTROLLER)}
        for role, other in ((PLANT, CONTROLLER), (CONTROLLER, PLANT)):
            self.ports[role].other = self.ports[other]
        self.plant = PlantNode(
            self.scene,
            self.ports[PLANT],
            RunOptions(timeout_s=self.timeout_s, shared_memory=self.shared_memory, pace=self.pace),
            repeat=self.repeat,
        )
        self.controller = ControllerNode(self.ports[CONTROLLER], shared_memory=self.takes_lane)

    def _control(self) -> None:
        try:
            while not self.controller.done:
                self.controller.work(self.timeout_s)
        except (BusError, StreamFault) as error:
            self.controller_fault = str(error)
            self.controller.fail(str(error))

    def run(self) -> "Pair":
        """Run both to their ends."""
        thread = threading.Thread(target=self._control)
        thread.start()
        try:
            self.stats = self.plant.run()
        except (BusError, StreamFault) as error:
            self.fault = str(error)
        thread.join(2 * EVENTUALLY_S)
        assert not thread.is_alive()
        return self

    def samples(self) -> dict[str, str]:
        """Digest of every compared array, joined over its blocks, and of the events."""
        heard = Heard()
        for envelope in self.heard:
            heard.take(envelope.stream, decoded(envelope))
        return heard.samples()

    def recorded(self, path: Path) -> Recording:
        """What a recorder makes of it."""
        recorder = Recorder(path)
        for envelope in self.heard:
            recorder.handle(envelope)
        recorder.reconcile()
        recorder.close()
        return read(path)
