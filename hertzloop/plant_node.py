"""The plant's side of the exchange: run as far as forces are known, send, wait, go on."""

import math
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from json import dumps

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log

from bus.messages_pb2 import Books, DaqBlock, Hello, TruthBlock
from bus.port import BusError, Port, Publisher
from bus.streams import Checker, StreamFault
from hertzloop import kernels as k
from hertzloop import parts
from hertzloop.events import PlantEvents, log
from hertzloop.scene import Scene, to_toml
from plant import kernels as pk

BLOCK_STEPS = 1000  # steps in a block of truth, samples in a block at most
_AHEAD_BLOCKS = 64  # samples that may be on their way while the controller has promised zero
_PACKAGES = ("hertzloop", "numpy", "numba", "eclipse-zenoh", "mcap", "protobuf")
TRUTH_FIELDS = ("xi_m", "xi_s_m", "xi_p_m", "v_p_m_s", "f_c_n", "f_a_n", "xi_a_m", "f_c1_n")


@dataclass(frozen=True)
class LoopStats:
    """How a run went in wall time; never part of a compared stream."""

    wall_s: float
    exchanges: int


def hello(scene: Scene, stiffness: float) -> Hello:
    """First message of a run."""
    return Hello(
        scene=scene.name,
        scene_toml=to_toml(scene),
        steps=scene.steps,
        step_ns=scene.run.step_ns,
        seed=scene.run.seed,
        stiffness=stiffness,
        versions=dumps({name: version(name) for name in _PACKAGES}),
    )


def new_run_id() -> int:
    """Random, never zero."""
    return secrets.randbits(63) | 1


def empty_window(steps: int, samples: int) -> k.Window:
    """Room for the truth of `steps` steps and for `samples` samples."""
    return k.Window(
        truth=np.zeros((k.TRUTH_COLUMNS, steps)),
        codes=np.zeros(samples, np.int64),
        values=np.zeros(samples),
        clipped=np.zeros(samples, np.int64),
        counts=np.zeros(k.WINDOW_COUNTS, np.int64),
    )


class PlantStreams:
    """Window of what the plant produced, and its way onto the bus in blocks.

    Blocks of truth and their events are cut at multiples of BLOCK_STEPS, whatever the
    exchange does.
    """

    def __init__(self, scene: Scene, publisher: Publisher, samples: int = BLOCK_STEPS) -> None:
        self.scene, self.publisher = scene, publisher
        self.plant = parts.plant(scene)
        self.sensor = parts.sensor(scene)
        self.window = empty_window(BLOCK_STEPS, samples)
        spec = self.sensor.spec
        self._events = PlantEvents(scene.run.step_ns, spec.every_steps, spec.quantity)
        self._clipped: list[np.ndarray] = []  # flags since the last block of truth
        self._flags_first = 0

    @property
    def step(self) -> int:
        """Present step."""
        return int(self.plant.state.counts[pk.STEP])

    def greet(self) -> None:
        """Announce the run."""
        self.publisher.send("hello", hello(self.scene, self.plant.model.stiffness))

    def samples_waiting(self) -> int:
        """Samples taken, but not sent."""
        counts = self.window.counts
        return int(counts[k.SAMPLES_END] - counts[k.SAMPLES_FIRST])

    def send_samples(self) -> None:
        """Publish the waiting samples, if there are any."""
        count, counts = self.samples_waiting(), self.window.counts
        if not count:
            return
        model, every = self.sensor.model, self.sensor.spec.every_steps
        clipped = self.window.clipped[:count].astype(np.uint8)
        header = DaqBlock(
            first_step=int(counts[k.SAMPLES_FIRST]) * every,
            step_ns=self.scene.run.step_ns,
            every_steps=every,
            scale=model.scale,
            offset=model.offset,
            saturated=clipped.tobytes() if model.limited else b"",
        )
        arrays = (
            {"value": self.window.values[:count]}
            if model.ideal
            else {"code": self.window.codes[:count]}
        )
        self.publisher.send("daq", header, arrays)
        self._clipped.append(clipped)
        counts[k.SAMPLES_FIRST] += count

    def send_truth(self) -> None:
        """Publish the waiting rows of truth and their events; samples must be sent before."""
        counts = self.window.counts
        first, end = int(counts[k.TRUTH_FIRST]), int(counts[k.TRUTH_END])
        if first == end:
            return
        rows = self.window.truth[:, : end - first]
        arrays = dict(zip(TRUTH_FIELDS, rows, strict=True))
        if self.plant.model.same_point:
            del arrays["xi_a_m"]
        if self.scene.run.scheme != "modal":
            del arrays["f_c1_n"]
        header = TruthBlock(first_step=first, step_ns=self.scene.run.step_ns)
        self.publisher.send("truth", header, arrays)
        # Flags of samples up to here; a later sample belongs to the next block.
        flags = np.concatenate([np.empty(0, np.uint8), *self._clipped])
        share = -(-end // self.sensor.spec.every_steps) - self._flags_first
        for event in self._events.of(first, rows[0], self._flags_first, flags[:share]):
            self.publisher.send("events/plant", event)
        self._clipped, self._flags_first = [flags[share:]], self._flags_first + share
        counts[k.TRUTH_FIRST] = end

    def finish(self) -> None:
        """Publish the books and the counts."""
        plant = self.plant
        closed = plant.close_books()
        header = Books(
            **vars(closed),
            frequencies=len(plant.modes.omega),
            frequency_limit_hz=plant.spec.frequency_limit_hz,
            expected_error=parts.model_error(self.scene),
        )
        self.publisher.send("books", header)
        self.publisher.end()

    def fail(self, sentence: str) -> None:
        """Publish what is there and why it ends here; a dead bus is no second fault."""
        try:
            self.send_samples()
            self.send_truth()
            event = log("plant", self.step, self.scene.run.step_ns, sentence, Log.FATAL)
            self.publisher.send("events/plant", event)
            self.publisher.end(fault=sentence)
        except BusError:
            pass


class PlantNode:
    """Runs a scene through a port, in lock-step with the controller at its other end.

    `horizon` is the largest number of steps between two exchanges; None leaves it to what
    the controller grants. It changes the speed and the blocks, never a sample.
    """

    def __init__(
        self,
        scene: Scene,
        port: Port,
        horizon: int | None = None,
        timeout_s: float = 10.0,
        on_progress: Callable[[int], None] = lambda step: None,
    ) -> None:
        self.scene, self.port, self.timeout_s = scene, port, timeout_s
        self.horizon = horizon or math.inf
        self.on_progress = on_progress
        self.streams = PlantStreams(scene, Publisher(port, new_run_id()))
        self.checker = Checker(self.streams.publisher.run_id, scene.run.step_ns)
        self.forces = np.zeros(scene.steps)
        self.forces_end = 0  # steps whose force has come, promised ones not counted
        self.samples_seen = 0
        self.exchanges = 0
        self.grant = k.Grant(
            counts=np.zeros(k.GRANT_COUNTS, np.int64),
            level=np.full(1, math.inf),  # no promise is known yet: any sample breaks it
            lead_steps=1 + scene.in_steps(scene.controller.latency_us),
        )

        self._advance(0)  # loads the kernel before the clock starts

    def _advance(self, end: int) -> bool:
        streams = self.streams
        return bool(
            k.advance(
                streams.plant.model, streams.plant.state, streams.sensor.model,
                streams.sensor.state, self.forces, streams.window, self.grant, end,
            )
        )  # fmt: skip

    def run(self) -> LoopStats:
        """The whole run. Raises BusError or StreamFault; says so on the bus first."""
        try:
            self.streams.greet()
            started = time.perf_counter()
            self._loop()
            wall_s = time.perf_counter() - started
            self.streams.finish()
        except (BusError, StreamFault) as error:
            self.streams.fail(f"run ended at step {self.streams.step}: {error}")
            raise
        return LoopStats(wall_s, self.exchanges)

    def _loop(self) -> None:
        streams, steps = self.streams, self.scene.steps
        last_exchange = 0
        while streams.step < steps:
            boundary = (streams.step // BLOCK_STEPS + 1) * BLOCK_STEPS
            end = int(min(boundary, steps, last_exchange + self.horizon))
            must_wait = self._advance(end)
            if streams.step >= last_exchange + self.horizon:
                must_wait, last_exchange = True, streams.step
            streams.send_samples()
            if streams.step % BLOCK_STEPS == 0 or streams.step == steps:
                streams.send_truth()
                self.on_progress(streams.step)
            if must_wait or self._too_far_ahead():
                self._exchange()
            while self.port.pending():
                self._take_forces()
        while self.forces_end < steps:
            self._take_forces()

    def _sent(self) -> int:
        return int(self.streams.window.counts[k.SAMPLES_FIRST])

    def _too_far_ahead(self) -> bool:
        return self._sent() - self.samples_seen > _AHEAD_BLOCKS * BLOCK_STEPS

    def _exchange(self) -> None:
        """Wait until the controller has answered all samples sent."""
        self.exchanges += 1
        while self.samples_seen < self._sent():
            self._take_forces()
        counts, step = self.grant.counts, self.streams.step
        observed = self.streams.window.counts[k.OBSERVED] > step
        if observed and not counts[k.PROMISED] and counts[k.GRANTED_END] <= step < self.scene.steps:
            raise StreamFault(
                f"the controller has seen all {self.samples_seen} samples, but granted no force "
                f"for step {step}"
            )

    def _take_forces(self) -> None:
        """Receive one block of forces. Raises StreamFault when it breaks what was promised."""
        envelope = self.port.receive(
            self.timeout_s, f"the force for step {self.forces_end} from the controller"
        )
        block = self.checker.accept(envelope)
        if envelope.stream == "end/controller":
            if block.header.fault or self.forces_end < self.scene.steps:
                raise StreamFault(f"the controller gave up: {block.header.fault or 'too early'}")
            return
        header, force = block.header, block.arrays["force_n"]
        first, end = header.first_step, header.first_step + len(force)
        if end > self.scene.steps:
            raise StreamFault(
                f"stream 'force' sequence {header.sequence} reaches step {end}, "
                f"the run has {self.scene.steps}"
            )
        done = min(self.streams.step, end)
        if first < done and np.any(self.forces[first:done] != force[: done - first]):
            raise StreamFault(
                f"stream 'force' sequence {header.sequence} breaks the promise of zero force "
                f"in steps {first} to {done - 1}, which are over"
            )
        self.forces[first:end] = force
        self.forces_end = end
        self.samples_seen = header.samples_seen
        counts = self.grant.counts
        counts[k.GRANTED_END] = max(counts[k.GRANTED_END], end)
        # A promise speaks of samples after those seen; it holds if none of the later ones
        # that were already taken broke it.
        same_level = self.grant.level[0] == header.promise_level
        all_seen = header.samples_seen == self.streams.window.counts[k.SAMPLES_END]
        if all_seen or (same_level and header.samples_seen >= counts[k.BROKEN_AT]):
            counts[k.PROMISED] = int(header.promise_zero)
            self.grant.level[0] = header.promise_level
