"""The whole closed loop in one compiled call per block: plant, sensor and controller."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from bus.messages_pb2 import ForceBlock
from bus.port import BusError, Port, Publisher
from bus.streams import StreamFault
from controller import kernels as ck
from controller import law_kernels as laws
from controller.door.bound import LawFault
from hertzloop import assembly as parts
from hertzloop import control
from hertzloop.first_impact import NEVER, ending_of
from hertzloop.loop import kernels as k
from hertzloop.loop.controller_node import set_up_by
from hertzloop.loop.events import ControllerEvents
from hertzloop.loop.hello import new_run_id
from hertzloop.loop.plant_node import LoopStats
from hertzloop.loop.plant_streams import BLOCK_STEPS, PlantStreams, empty_window
from hertzloop.loop.watchdog import watching
from hertzloop.scenes.scene import Scene, SceneError
from plant import state_kernels as pk
from plant.balance import Balance
from plant.plant import Plant
from plant.schemes.thesis2008 import ThesisPlant

_PIECE_STEPS = 1 << 16


class LawStopped(SceneError):
    """The law failed in a run; `rows` of truth, shape (10, steps), are those before."""

    def __init__(self, said: str, rows: np.ndarray) -> None:
        super().__init__(said)
        self.rows = rows


class Clock:
    """Seconds of processor time that the compiled loop of `simulate` has taken so far."""

    seconds = 0.0


IN_LOOP = Clock()


@dataclass(frozen=True)
class Simulated:
    """A simulated run in memory: rows as in TruthBlock, shape (10, steps), samples as they would
    be sent (values, or codes of a converter) and their values, commanded forces (N), the law's
    mode and latched delay (samples) after each, books, and whether the run ended because nothing
    that was to come could belong to its first impact."""

    rows: np.ndarray
    samples: np.ndarray
    values: np.ndarray
    forces: np.ndarray
    modes: np.ndarray
    delays: np.ndarray
    books: Balance
    over: bool


def simulate(scene: Scene, impact_only: bool = False, own_plant: Plant | None = None) -> Simulated:
    """Run a scene without bus or recording, on its plant, or on `own_plant`, at its start.

    With `impact_only` the run ends once nothing that is to come can belong to its first impact.
    Raises LawStopped when the law fails.
    """
    plant, sensor = own_plant or parts.plant(scene), parts.sensor(scene)
    controller = control.controller(scene, plant.model.stiffness, ahead=impact_only)
    samples = len(controller.law_state.history)
    window = empty_window(scene.steps, samples)
    modes, delays = np.zeros(samples, np.int64), np.zeros(samples, np.int64)
    with watching(scene, lambda: int(controller.law_state.counts[laws.SAMPLES])):
        started = time.thread_time()
        over = k.closed_loop(
            plant.model, plant.state, sensor.model, sensor.state, controller.law,
            controller.law_state, controller.line, controller.line_state, controller.forces,
            window, modes, delays, scene.steps, ending_of(scene) if impact_only else NEVER,
        )  # fmt: skip
        IN_LOOP.seconds += time.thread_time() - started
    try:
        controller.check()
    except LawFault as error:
        before = controller.failed_at * scene.sensors.every_steps + 1
        raise LawStopped(str(error), window.truth[:, :before]) from error
    steps, taken = (int(window.counts[i]) for i in (k.TRUTH_END, k.SAMPLES_END))
    sent = window.values if sensor.model.ideal else window.codes
    return Simulated(
        window.truth[:, :steps],
        sent[:taken],
        window.values[:taken],
        controller.forces[:steps],
        modes[:taken],
        delays[:taken],
        plant.close_balance(),
        bool(over),
    )


def uncontrolled_rows(scene: Scene) -> Iterator[tuple[int, np.ndarray]]:
    """Rows of truth of a scene without control in blocks: first step, rows of shape (10, steps)."""
    plant, no_force = parts.plant(scene), np.zeros(_PIECE_STEPS)
    for first in range(0, scene.steps, _PIECE_STEPS):
        window = empty_window(min(_PIECE_STEPS, scene.steps - first), 0)
        k.plant_alone(plant.model, plant.state, no_force[: window.truth.shape[1]], window)
        yield first, window.truth


def closed_loop_rows(scene: Scene, disturbance: float = 0.0) -> Iterator[tuple[int, np.ndarray]]:
    """Rows of truth of a scene with its law in blocks: first step, rows of shape (10, steps); the
    sphere starts faster by `disturbance`, relative. Raises SceneError when the law fails."""
    plant, sensor = parts.plant(scene), parts.sensor(scene)
    controller = control.controller(scene, plant.model.stiffness, ahead=False)
    plant.state.body[pk.FLIGHT_V] *= 1.0 + disturbance
    modes, delays = np.zeros(_PIECE_STEPS, np.int64), np.zeros(_PIECE_STEPS, np.int64)
    counts = np.zeros(k.WINDOW_COUNTS, np.int64)
    for first in range(0, scene.steps, _PIECE_STEPS):
        length = min(_PIECE_STEPS, scene.steps - first)
        window = empty_window(length, length)
        window.counts[:] = counts
        window.counts[[k.TRUTH_FIRST, k.TRUTH_END]] = 0
        window.counts[k.SAMPLES_FIRST] = counts[k.SAMPLES_END]
        k.closed_loop(
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


def rows_under(plant: Plant | ThesisPlant, forces: np.ndarray) -> np.ndarray:
    """Rows of truth, shape (10, steps), of a plant under commanded forces (N), one a step."""
    window = empty_window(len(forces), 0)
    k.plant_alone(plant.model, plant.state, forces, window)
    return window.truth


def run_compiled(
    scene: Scene,
    plant_port: Port,
    controller_port: Port,
    on_progress: Callable[[int], None] = lambda step: None,
) -> LoopStats:
    """Run a scene and publish the streams that the processes would publish."""
    run_id = new_run_id()
    streams = PlantStreams(scene, Publisher(plant_port, run_id))
    publisher = Publisher(controller_port, run_id)
    controller = control.controller(scene, streams.plant.model.stiffness, ahead=False)
    events = ControllerEvents(scene)
    modes, delays = np.zeros(BLOCK_STEPS, np.int64), np.zeros(BLOCK_STEPS, np.int64)

    def advance(end: int) -> None:
        k.closed_loop(
            streams.plant.model, streams.plant.state, streams.sensor.model, streams.sensor.state,
            controller.law, controller.law_state, controller.line, controller.line_state,
            controller.forces, streams.window, modes, delays, end, NEVER,
        )  # fmt: skip

    def loop() -> float:
        wall_s, sent = 0.0, 0
        while streams.step < scene.steps:
            started = time.perf_counter()
            advance(min(streams.step + BLOCK_STEPS, scene.steps))
            wall_s += time.perf_counter() - started
            try:
                controller.check()
            except LawFault as error:
                raise StreamFault(str(error)) from error
            first = int(streams.window.counts[k.SAMPLES_FIRST])
            count = streams.samples_waiting()
            streams.send_samples()
            streams.send_truth()
            end = int(controller.line_state.counts[ck.EMITTED])
            answer = ForceBlock(
                first_step=sent,
                step_ns=scene.run.step_ns,
                samples_seen=int(controller.law_state.counts[laws.SAMPLES]),
            )
            publisher.send("force", answer, {"force_n": controller.forces[sent:end]})
            sent = end
            for event in events.of(first, modes[:count], delays[:count]):
                publisher.send("events/controller", event)
            on_progress(streams.step)
        return wall_s

    advance(0)  # loads the kernel before the clock starts
    set_up = set_up_by(scene, streams.plant.model.stiffness)
    try:
        streams.greet()
        wall_s = loop()
        streams.finish()
    except (BusError, StreamFault) as error:
        streams.fail(f"run ended at step {streams.step}: {error}")
        publisher.end(fault=str(error), set_up=set_up)
        raise
    publisher.end(set_up=set_up)
    return LoopStats(wall_s, 0, f"{run_id:x}")
