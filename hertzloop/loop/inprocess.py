"""Plant, controller and recorder in one process, over the in-process bus."""

from collections.abc import Callable
from pathlib import Path

from bus.inprocess import InProcessBus, InProcessPort
from bus.port import BusError
from bus.streams import CONTROLLER, PLANT, RECORDER, Envelope, StreamFault
from hertzloop.loop.compiled import run_compiled
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.loop.plant_node import LoopStats, PlantNode
from hertzloop.loop.watchdog import watching
from hertzloop.setup import Setup
from recordings.recorder import Recorder
from recordings.writer import RecordingError


def record_in_process(
    setup: Setup,
    recording: Path,
    *,
    compiled: bool,
    horizon: int | None = None,
    overwrite: bool = False,
    on_progress: Callable[[int], None] = lambda step: None,
) -> LoopStats:
    """Run a scene in this process and record it; `compiled` takes the one-call loop.

    Raises BusError, StreamFault or RecordingError; the recording is closed and readable then.
    """
    recorder = Recorder(recording, overwrite)
    bus = InProcessBus()
    InProcessPort(bus, RECORDER, recorder.handle)

    gave_up: list[StreamFault] = []

    def messages() -> int:
        return sum(counter.messages for counter in list(recorder.counters.values()))

    try:
        with watching(setup, messages, recorder.close, "messages"):
            if compiled:
                ports = (InProcessPort(bus, PLANT), InProcessPort(bus, CONTROLLER))
                stats = run_compiled(setup, *ports, on_progress)
            else:
                plant_port = InProcessPort(bus, PLANT)
                node: ControllerNode | None = None

                def to_controller(envelope: Envelope) -> None:
                    if node is None or gave_up:
                        return
                    try:
                        node.handle(envelope)
                    except StreamFault as error:  # the plant has to hear of it, as from afar
                        gave_up.append(error)
                        node.fail(str(error))

                node = ControllerNode(InProcessPort(bus, CONTROLLER, to_controller))
                plant = PlantNode(setup, plant_port, horizon, on_progress=on_progress)
                stats = plant.run()
        recorder.reconcile()
        if gave_up:
            raise gave_up[0]
    except (BusError, StreamFault, RecordingError, KeyboardInterrupt) as error:
        recorder.close(fault=str(error) or "interrupted")
        if gave_up and error is not gave_up[0]:
            raise gave_up[0] from error
        raise
    recorder.close()
    return stats
