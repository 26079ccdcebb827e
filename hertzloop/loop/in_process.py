"""A scene run and recorded within this process."""

import time
from collections.abc import Callable
from pathlib import Path

from hertzloop.bus.messages_pb2 import ForceBlock
from hertzloop.bus.port import BusError, InProcessBus, InProcessPort, Publisher, new_run_id
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, Envelope, StreamFault
from hertzloop.closed_loop import loop
from hertzloop.closed_loop.exchange import DIRECT, SAMPLES_FIRST
from hertzloop.closed_loop.parts import controller_side, exchange, plant_side
from hertzloop.common.protocols import Port
from hertzloop.controller import law_kernels as laws
from hertzloop.controller.controller import Controller
from hertzloop.controller.kernels import EMITTED
from hertzloop.controller.loading.bound import LawFault
from hertzloop.loop.announcement import controller_report
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.loop.events import ControllerEvents
from hertzloop.loop.plant_node import LoopStats, PlantNode
from hertzloop.loop.plant_streams import EVERY_S, PlantStreams
from hertzloop.loop.run_options import USUAL_RUN, RunOptions
from hertzloop.loop.stuck_law import watching
from hertzloop.recordings.recorder import Recorder
from hertzloop.recordings.writer import RecordingError
from hertzloop.scene.controller import build_controller
from hertzloop.scene.setup import Setup


def run_compiled(
    setup: Setup,
    controller: Controller,
    plant_port: Port,
    controller_port: Port,
    on_progress: Callable[[int], None] = lambda step: None,
) -> LoopStats:
    """Run a scene in one compiled loop, and publish the streams that the processes would publish.

    Raises:
        BusError, StreamFault: The run has failed; the recorder was told.
    """
    run_id = new_run_id()
    streams = PlantStreams(setup, Publisher(plant_port, run_id), every_s=EVERY_S)
    publisher = Publisher(controller_port, run_id)
    events = ControllerEvents(setup)
    side, unsent = plant_side(streams.plant, streams.sensor), streams.unsent
    direct = exchange(DIRECT, controller_side(controller))
    loop.run(side, direct, unsent, 0)  # loads the kernel before the clock starts
    report = controller_report(setup)
    try:
        streams.announce_run()
        wall_s, sent = 0.0, 0
        while streams.step < setup.run.steps:
            started = time.perf_counter()
            loop.run(side, direct, unsent, streams.boundary)
            wall_s += time.perf_counter() - started
            try:
                controller.check()
            except LawFault as error:
                raise StreamFault(str(error)) from error
            if not streams.due:
                continue
            first = int(unsent.counts[SAMPLES_FIRST])
            count = streams.samples_waiting()
            streams.send_samples()
            streams.send_truth()
            end = int(controller.path_state.counts[EMITTED])
            answer = ForceBlock(
                first_step=sent,
                step_ns=setup.run.step_ns,
                samples_seen=int(controller.law_state.counts[laws.SAMPLES]),
            )
            publisher.send("force", answer, {"force_n": controller.forces[sent:end]})
            sent = end
            for event in events.of(first, unsent.modes[:count], unsent.delays[:count]):
                publisher.send("events/controller", event)
            on_progress(streams.step)
        streams.finish()
    except (BusError, StreamFault) as error:
        streams.fail(f"run ended at step {streams.step}: {error}")
        publisher.end(fault=str(error), report=report)
        raise
    publisher.end(report=report)
    return LoopStats(wall_s, 0, f"{run_id:x}")


def record_in_process(
    setup: Setup,
    recording: Path,
    options: RunOptions = USUAL_RUN,
    on_progress: Callable[[int], None] = lambda step: None,
    *,
    compiled: bool,
) -> LoopStats:
    """Run and record a scene in this process.

    Args:
        setup: Setup of the run.
        recording: The MCAP file to write.
        options: Whether to overwrite a file, and the most steps between exchanges.
        on_progress: Called with the number of finished steps.
        compiled: Run plant and controller in one compiled loop, instead of exchanging messages.

    Raises:
        BusError, StreamFault, RecordingError: The run has failed. The recording is closed and
            readable.
    """
    recorder = Recorder(recording, options.overwrite, options.note)
    bus = InProcessBus()
    InProcessPort(bus, RECORDER, recorder.handle)

    faults: list[StreamFault] = []

    given: list[Callable[[], int]] = []  # number of samples that the law was given

    def progress() -> int:
        messages = sum(counter.messages for counter in list(recorder.counters.values()))
        return messages + sum(samples() for samples in given)

    try:
        with watching(setup, progress, recorder.close, "samples and messages"):
            if compiled:
                ports = (InProcessPort(bus, PLANT), InProcessPort(bus, CONTROLLER))
                controller = build_controller(setup, ahead=False)
                given.append(lambda: int(controller.law_state.counts[laws.SAMPLES]))
                stats = run_compiled(setup, controller, *ports, on_progress)
            else:
                plant_port = InProcessPort(bus, PLANT)
                node: ControllerNode | None = None

                def to_controller(envelope: Envelope) -> None:
                    if node is None or faults:
                        return
                    try:
                        node.handle(envelope)
                    except StreamFault as error:  # the plant is told by a message, as elsewhere
                        faults.append(error)
                        node.fail(str(error))

                node = ControllerNode(InProcessPort(bus, CONTROLLER, to_controller))
                given.append(lambda: node.law_samples if node else 0)
                apart = options.model_copy(update={"shared_memory": False})
                plant = PlantNode(setup, plant_port, apart, on_progress)
                stats = plant.run()
        recorder.reconcile()
        if faults:
            raise faults[0]
    except (BusError, StreamFault, RecordingError, KeyboardInterrupt) as error:
        recorder.close(fault=str(error) or "interrupted")
        if faults and error is not faults[0]:
            raise faults[0] from error
        raise
    recorder.close()
    return stats
