"""The whole closed loop in one compiled call per block: plant, sensor and controller."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bus.messages_pb2 import ForceBlock
from bus.port import Port, Publisher
from controller import kernels as ck
from controller import law_kernels as laws
from hertzloop import kernels as k
from hertzloop import parts
from hertzloop.events import ControllerEvents
from hertzloop.plant_node import (
    BLOCK_STEPS,
    LoopStats,
    PlantStreams,
    empty_window,
    new_run_id,
)
from hertzloop.scene import Scene
from plant.plant import Books, Plant
from plant.thesis2008 import ThesisPlant


@dataclass(frozen=True)
class Simulated:
    """A simulated run in memory: rows as in TruthBlock, shape (8, steps), samples as they would
    be sent (values, or codes of a converter), the law's mode and latched delay (samples) after
    each, books, and whether the run was cut because its first impact was over."""

    rows: np.ndarray
    samples: np.ndarray
    modes: np.ndarray
    delays: np.ndarray
    books: Books
    over: bool


def simulate(scene: Scene, quiet_steps: int = -1) -> Simulated:
    """Run a scene without bus or recording.

    With `quiet_steps` only until its first contact has been over for so long and no force is left
    to come.
    """
    plant, sensor = parts.plant(scene), parts.sensor(scene)
    controller = parts.controller(scene, plant.model.stiffness)
    samples = len(controller.law_state.history)
    window = empty_window(scene.steps, samples)
    modes, delays = np.zeros(samples, np.int64), np.zeros(samples, np.int64)
    over = k.closed_loop(
        plant.model, plant.state, sensor.model, sensor.state, controller.law,
        controller.law_state, controller.line, controller.line_state, controller.forces,
        window, modes, delays, scene.steps, quiet_steps,
    )  # fmt: skip
    steps, taken = (int(window.counts[i]) for i in (k.TRUTH_END, k.SAMPLES_END))
    sent = window.values if sensor.model.ideal else window.codes
    return Simulated(
        window.truth[:, :steps],
        sent[:taken],
        modes[:taken],
        delays[:taken],
        plant.close_books(),
        bool(over),
    )


def rows_under(plant: Plant | ThesisPlant, forces: np.ndarray) -> np.ndarray:
    """Rows of truth, shape (8, steps), of a plant under given actuator forces (N), one a step."""
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
    controller = parts.controller(scene, streams.plant.model.stiffness)
    events = ControllerEvents(scene)
    modes, delays = np.zeros(BLOCK_STEPS, np.int64), np.zeros(BLOCK_STEPS, np.int64)

    def advance(end: int) -> None:
        k.closed_loop(
            streams.plant.model, streams.plant.state, streams.sensor.model, streams.sensor.state,
            controller.law, controller.law_state, controller.line, controller.line_state,
            controller.forces, streams.window, modes, delays, end, -1,
        )  # fmt: skip

    advance(0)  # loads the kernel before the clock starts
    streams.greet()
    wall_s, sent = 0.0, 0
    while streams.step < scene.steps:
        started = time.perf_counter()
        advance(min(streams.step + BLOCK_STEPS, scene.steps))
        wall_s += time.perf_counter() - started
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
    streams.finish()
    publisher.end()
    return LoopStats(wall_s, 0)
