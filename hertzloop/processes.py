"""The three processes of a run over zenoh, each as one function: role, port, loop, end.

Every function returns statistics for the launcher, or raises BusError, StreamFault or
RecordingError with one sentence.
"""

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from bus.port import BusError
from bus.streams import CONTROLLER, PLANT, RECORDER, StreamFault
from bus.zenoh_port import ZenohPort
from hertzloop.scene import Scene
from recordings.recorder import Recorder
from recordings.writer import RecordingError

BASE_PORT = 7450
_GRACE_S = 2.0  # for the others to hear of a fault
_ORDER = (PLANT, CONTROLLER, RECORDER)


@dataclass(frozen=True)
class BusAddress:
    """Where a role meets the others: the run's name and explicit endpoints, full mesh."""

    name: str
    listen: Sequence[str]
    connect: Sequence[str] = ()
    config_file: Path | None = None
    timeout_s: float = 5.0  # longest wait for a message during the run
    wait_s: float = 30.0  # longest wait for the others to appear

    def open(self, role: str) -> ZenohPort:
        """Join the bus. Raises BusError."""
        return ZenohPort(role, self.name, self.listen, self.connect, self.config_file)


def default_endpoints(role: str, ports: Sequence[int]) -> tuple[list[str], list[str]]:
    """Endpoints on loopback for a role: listen on its own, connect to those before it."""
    urls = [f"tcp/127.0.0.1:{port}" for port in ports]
    place = _ORDER.index(role)
    return [urls[place]], urls[:place]


class Interrupted(RuntimeError):
    """Somebody asked the run to stop."""


@contextmanager
def _joined(address: BusAddress, role: str) -> Iterator[ZenohPort]:
    """Join the bus, and leave it after the recorder, so that nothing sent is lost."""
    port = address.open(role)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: port.interrupt())
    patience_s = _GRACE_S
    try:
        yield port
        patience_s = address.timeout_s
    finally:
        if role != RECORDER:
            port.wait_until_gone(RECORDER, patience_s)
        port.close()


def run_plant(
    scene: Scene,
    address: BusAddress,
    horizon: int | None = None,
    on_ready: Callable[[], None] = lambda: None,
    on_progress: Callable[[int], None] = lambda step: None,
) -> dict[str, float]:
    """The plant process: waits for the others, runs the scene, says how fast that went."""
    from hertzloop.plant_node import PlantNode

    with _joined(address, PLANT) as port:
        node = PlantNode(scene, port, horizon, address.timeout_s, on_progress)
        port.announce()
        port.wait_for([CONTROLLER, RECORDER], address.wait_s)
        on_ready()
        try:
            stats = node.run()
        except KeyboardInterrupt as error:
            node.streams.fail(f"interrupted at step {node.streams.step}")
            raise Interrupted(f"interrupted at step {node.streams.step}") from error
    return {"wall_s": stats.wall_s, "exchanges": stats.exchanges}


def run_controller(
    address: BusAddress, on_ready: Callable[[], None] = lambda: None
) -> dict[str, float]:
    """The controller process: answers samples until the plant announces its end."""
    from hertzloop.controller_node import ControllerNode

    with _joined(address, CONTROLLER) as port:
        node = ControllerNode(port)
        port.announce()
        port.wait_for([PLANT, RECORDER], address.wait_s)
        on_ready()
        try:
            while not node.done:
                node.handle(port.receive(address.timeout_s, "samples from the plant"))
        except (StreamFault, KeyboardInterrupt) as error:
            sentence = str(error) or "the controller was interrupted"
            node.fail(sentence)
            if isinstance(error, KeyboardInterrupt):
                raise Interrupted(sentence) from error
            raise
    return {}


def run_recorder(
    path: Path,
    address: BusAddress,
    overwrite: bool = False,
    on_ready: Callable[[], None] = lambda: None,
) -> dict[str, float]:
    """The recorder process: writes everything down until both roles have ended."""
    recorder = Recorder(path, overwrite)
    started = time.monotonic()
    fault = "the recorder was interrupted"
    try:
        with _joined(address, RECORDER) as port:
            port.announce()
            port.wait_for([PLANT, CONTROLLER], address.wait_s)
            on_ready()
            while not recorder.done:
                envelope = port.receive(address.timeout_s, "messages from plant and controller")
                recorder.handle(envelope)
                if envelope.stream.startswith("end/"):
                    port.release(envelope.stream.removeprefix("end/"))
        fault = ""
        recorder.reconcile()
    except (BusError, StreamFault, RecordingError) as error:
        fault = str(error)
        raise
    except KeyboardInterrupt as error:
        raise Interrupted(fault) from error
    finally:
        try:
            recorder.close(fault)
        except RecordingError:
            if not fault:
                raise
    if recorder.faults:
        raise StreamFault(recorder.faults[0])
    return {"recorder_s": time.monotonic() - started}
