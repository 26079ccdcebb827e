"""The whole closed loop in one compiled call per block: plant, sensor and controller."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from hertzloop.bus.messages_pb2 import ForceBlock
from hertzloop.bus.port import BusError, InProcessBus, InProcessPort, Port, Publisher, new_run_id
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, Envelope, StreamFault
from hertzloop.controller import law_kernels as laws
from hertzloop.controller.kernels import EMITTED
from hertzloop.controller.loading.bound import LawFault
from hertzloop.loop import kernels as loop_kernels
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.loop.events import ControllerEvents
from hertzloop.loop.kernels import SAMPLES_END, SAMPLES_FIRST, TRUTH_END, TRUTH_FIRST, WINDOW_COUNTS
from hertzloop.loop.plant_node import LoopStats, PlantNode
from hertzloop.loop.plant_streams import EVERY_S, ROOM_STEPS, PlantStreams, empty_window, set_up_by
from hertzloop.loop.run_options import USUAL_RUN, RunOptions
from hertzloop.loop.watchdog import watching
from hertzloop.plant.actuator import rest_force_n
from hertzloop.plant.figures.rows_kernels import NEVER, Answer, answer
from hertzloop.plant.plant import Balance, Plant
from hertzloop.plant.state_kernels import FLIGHT_V
from hertzloop.plant.time_series import COLUMNS
from hertzloop.recordings.recorder import Recorder
from hertzloop.recordings.writer import RecordingError
from hertzloop.scene.build import build_plant, build_sensor
from hertzloop.scene.controller import build_controller
from hertzloop.scene.errors import SceneError
from hertzloop.scene.quantities import SENSED
from hertzloop.scene.setup import Setup

_QUIET_S = 1e-4  # silence after which a law that pushes again has begun anew
_LEAST_STEPS = 2  # in which a rebound is seen
_SIGMAS = 8.0  # no noise is larger


def quiet_steps(setup: Setup) -> int:
    """Steps of silence after which a new force may belong to the next contact."""
    quiet = round(_QUIET_S / setup.step_s) + setup.line.most_added_steps
    return max(quiet, _LEAST_STEPS)


def answer_of(setup: Setup) -> Answer:
    """An impact of the scene, before its first touch, for rows that are known."""
    quiet = quiet_steps(setup)
    line_steps = 1 + setup.line.latency_steps + setup.line.most_added_steps
    return answer(quiet, line_steps, rest_n=rest_force_n(setup.actuator, setup.step_s))


def ending_of(setup: Setup) -> Answer:
    """The same for a loop that ends as soon as nothing to come can belong to the impact."""
    if setup.quantity != "xi":
        return answer_of(setup)
    blur_m = _SIGMAS * setup.sensor.noise_rms + setup.converter_step
    return answer_of(setup)._replace(blur_m=blur_m)


_PIECE_STEPS = 1 << 16


class LawStopped(SceneError):
    """The law failed in a run; `rows` of truth, shape (10, steps), are those before."""

    def __init__(self, said: str, rows: np.ndarray) -> None:
        super().__init__(said)
        self.rows = rows


class LoopTimer:
    """Seconds of processor time that the compiled loop of `simulate` has taken while `running`: to
    read the clock of a thread may cost more than a case."""

    seconds = 0.0
    running = False


IN_LOOP = LoopTimer()


@dataclass(frozen=True)
class SimulatedRun:
    """A simulated run in memory: rows as in TruthBlock, shape (10, steps), samples as they would
    be sent (values, or codes of a converter) and their values, commanded forces (N), the law's
    mode and latched delay (samples) after each, balance, and whether the run ended because nothing
    that was to come could belong to its first impact."""

    rows: np.ndarray
    samples: np.ndarray
    values: np.ndarray
    forces: np.ndarray
    modes: np.ndarray
    delays: np.ndarray
    balance: Balance
    over: bool


def simulate(
    setup: Setup,
    impact_only: bool = False,
    own_plant: Plant | None = None,
    steps: int | None = None,
) -> SimulatedRun:
    """Run a scene without bus or recording, on its plant, or on `own_plant`, at its start.

    With `impact_only` the run ends once nothing that is to come can belong to its first impact.
    It ends after `steps` steps, by default those of the scene.
    Raises LawStopped when the law fails.
    """
    most = steps or setup.steps
    plant = own_plant or build_plant(setup, steps=most)
    sensor = build_sensor(setup, most)
    controller = build_controller(setup, ahead=impact_only, steps=most)
    samples = len(controller.law_state.history)
    window = empty_window(most, samples)
    modes, delays = np.zeros(samples, np.int64), np.zeros(samples, np.int64)
    with watching(setup, lambda: int(controller.law_state.counts[laws.SAMPLES])):
        started = time.thread_time() if IN_LOOP.running else 0.0
        over = loop_kernels.closed_loop(
            plant.model, plant.state, sensor.model, sensor.state, controller.law,
            controller.law_state, controller.line, controller.line_state, controller.forces,
            window, modes, delays, most, ending_of(setup) if impact_only else NEVER,
        )  # fmt: skip
        if IN_LOOP.running:
            IN_LOOP.seconds += time.thread_time() - started
    try:
        controller.check()
    except LawFault as error:
        before = controller.failed_at * setup.every_steps + 1
        raise LawStopped(str(error), window.truth[:, :before]) from error
    ran, taken = int(window.counts[TRUTH_END]), int(window.counts[SAMPLES_END])
    sent = window.values if sensor.model.ideal else window.codes
    return SimulatedRun(
        window.truth[:, :ran],
        sent[:taken],
        window.values[:taken],
        controller.forces[:ran],
        modes[:taken],
        delays[:taken],
        plant.close_balance(),
        bool(over),
    )


def closed_loop_rows(setup: Setup, disturbance: float = 0.0) -> Iterator[tuple[int, np.ndarray]]:
    """Rows of truth of a scene with its law in blocks: first step, rows of shape (10, steps); the
    sphere starts faster by `disturbance`, relative. Raises SceneError when the law fails."""
    plant, sensor = build_plant(setup), build_sensor(setup)
    controller = build_controller(setup, ahead=False)
    plant.state.body[FLIGHT_V] *= 1.0 + disturbance
    modes, delays = np.zeros(_PIECE_STEPS, np.int64), np.zeros(_PIECE_STEPS, np.int64)
    counts = np.zeros(WINDOW_COUNTS, np.int64)
    for first in range(0, setup.steps, _PIECE_STEPS):
        length = min(_PIECE_STEPS, setup.steps - first)
        window = empty_window(length, length)
        window.counts[:] = counts
        window.counts[[TRUTH_FIRST, TRUTH_END]] = 0
        window.counts[SAMPLES_FIRST] = counts[SAMPLES_END]
        loop_kernels.closed_loop(
            plant.model, plant.state, sensor.model, sensor.state, controller.law,
            controller.law_state, controller.line, controller.line_state, controller.forces,
            window, modes, delays, first + length, NEVER,
        )  # fmt: skip
        try:
            controller.check()
        except LawFault as error:
            raise SceneError(str(error)) from error
        counts = window.counts
        yield first, window.truth


def run_compiled(
    setup: Setup,
    plant_port: Port,
    controller_port: Port,
    on_progress: Callable[[int], None] = lambda step: None,
) -> LoopStats:
    """Run a scene and publish the streams that the processes would publish."""
    run_id = new_run_id()
    streams = PlantStreams(setup, Publisher(plant_port, run_id), every_s=EVERY_S)
    publisher = Publisher(controller_port, run_id)
    controller = build_controller(setup, ahead=False)
    events = ControllerEvents(setup)
    modes, delays = np.zeros(ROOM_STEPS, np.int64), np.zeros(ROOM_STEPS, np.int64)
    advance = partial(
        loop_kernels.closed_loop,
        streams.plant.model, streams.plant.state, streams.sensor.model, streams.sensor.state,
        controller.law, controller.law_state, controller.line, controller.line_state,
        controller.forces, streams.window, modes, delays,
    )  # fmt: skip
    advance(0, NEVER)  # loads the kernel before the clock starts
    set_up = set_up_by(setup)
    try:
        streams.greet()
        wall_s, sent = 0.0, 0
        while streams.step < setup.steps:
            started = time.perf_counter()
            advance(streams.boundary, NEVER)
            wall_s += time.perf_counter() - started
            try:
                controller.check()
            except LawFault as error:
                raise StreamFault(str(error)) from error
            if not streams.due:
                continue
            first = int(streams.window.counts[SAMPLES_FIRST])
            count = streams.samples_waiting()
            streams.send_samples()
            streams.send_truth()
            end = int(controller.line_state.counts[EMITTED])
            answer = ForceBlock(
                first_step=sent,
                step_ns=setup.step_ns,
                samples_seen=int(controller.law_state.counts[laws.SAMPLES]),
            )
            publisher.send("force", answer, {"force_n": controller.forces[sent:end]})
            sent = end
            for event in events.of(first, modes[:count], delays[:count]):
                publisher.send("events/controller", event)
            on_progress(streams.step)
        streams.finish()
    except (BusError, StreamFault) as error:
        streams.fail(f"run ended at step {streams.step}: {error}")
        publisher.end(fault=str(error), set_up=set_up)
        raise
    publisher.end(set_up=set_up)
    return LoopStats(wall_s, 0, f"{run_id:x}")


def finer_loop(setup: Setup, plant: Plant, steps: int, parts_of_step: int) -> np.ndarray:
    """Rows of truth, shape (10, steps * parts_of_step), of the first `steps` steps of a scene on a
    plant at its start that takes `parts_of_step` steps in each of them.

    Samples, forces and what is drawn by chance belong to the steps of the scene; a force is held
    over one. Raises SceneError when the law fails.
    """
    sensor = build_sensor(setup, steps)
    controller = build_controller(setup, ahead=False, steps=steps)
    truth = np.zeros((COLUMNS, steps * parts_of_step))
    with watching(setup, lambda: int(controller.law_state.counts[laws.SAMPLES])):
        loop_kernels.loop_in_parts(
            plant.model, plant.state, sensor.model, sensor.state, controller.law,
            controller.law_state, controller.line, controller.line_state, controller.forces,
            truth, parts_of_step, SENSED[setup.quantity].over_step,
        )  # fmt: skip
    try:
        controller.check()
    except LawFault as error:
        raise SceneError(str(error)) from error
    return truth


def recorder_of(recording: Path, options: RunOptions) -> Recorder:
    """The recorder of a run. Raises RecordingError."""
    return Recorder(recording, options.overwrite)


def record_in_process(
    setup: Setup,
    recording: Path,
    options: RunOptions = USUAL_RUN,
    on_progress: Callable[[int], None] = lambda step: None,
    *,
    compiled: bool,
) -> LoopStats:
    """Run a scene in this process and record it; `compiled` takes the one-call loop.

    Raises BusError, StreamFault or RecordingError; the recording is closed and readable then.
    """
    recorder = recorder_of(recording, options)
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
                plant = PlantNode(setup, plant_port, options.horizon, on_progress=on_progress)
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
