"""Streams that the plant publishes: samples, time series, events and the energy balance."""

import time
from collections.abc import Callable
from contextlib import suppress
from zlib import crc32

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log

from hertzloop.bus.events import event
from hertzloop.bus.messages_pb2 import (
    DaqBlock,
    EnergyBalance,
    EventKind,
    LawText,
    SceneText,
    TruthBlock,
)
from hertzloop.bus.port import BusError, Publisher
from hertzloop.bus.streams import StreamFault
from hertzloop.closed_loop.exchange import SAMPLES_END, SAMPLES_FIRST, TRUTH_END, TRUTH_FIRST
from hertzloop.closed_loop.parts import empty_unsent
from hertzloop.loop.announcement import hello
from hertzloop.loop.events import PlantEvents
from hertzloop.plant.contact.yielding import above_dent_m
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.state_kernels import STEP
from hertzloop.plant.time_series import DEEPEST, TRUTH, XI
from hertzloop.scene.build import build_plant, build_sensor
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml

BLOCK_STEPS = 1000  # blocks end at whole multiples of it
ROOM_STEPS = 10 * BLOCK_STEPS  # steps in a block of truth, samples in a block at most
EVERY_S = 0.01  # least time between two blocks; a message costs as much as hundreds of steps


def truth_columns(truth: np.ndarray, setup: Setup, same_point: bool) -> dict[str, np.ndarray]:
    """Return time series by the fields of a TruthBlock, as far as the scene has them.

    Args:
        truth: Time series, shape (10, steps).
        setup: Setup of the run.
        same_point: The actuator acts at the contact point; its displacement is omitted then.
    """
    arrays = dict(zip(TRUTH, truth, strict=True))
    if same_point:
        del arrays["xi_a_m"]
    if not SCHEMES[setup.run.scheme].records_slope:
        del arrays["f_c1_n"]
    if setup.mechanics.actuator.bandwidth_hz is None:
        del arrays["f_a1_n"]
    if setup.mechanics.contact.limit is None:
        del arrays["deepest_m"]
    return arrays


class PlantStreams:
    """Publishes in blocks what the plant produces.

    Blocks of time series end at multiples of BLOCK_STEPS.
    """

    def __init__(
        self,
        setup: Setup,
        publisher: Publisher,
        held_steps: np.ndarray | None = None,
        every_s: float = 0.0,
    ) -> None:
        """
        Args:
            setup: Setup of the run.
            publisher: Publishes on the bus.
            held_steps: For each step, how many steps older than that step its command is. None in
                lock-step.
            every_s: Least wall time between two blocks.
        """
        self.setup, self.publisher, self._held_steps = setup, publisher, held_steps
        self.plant = build_plant(setup)
        self.sensor = build_sensor(setup)
        self.unsent = empty_unsent(ROOM_STEPS, ROOM_STEPS)
        self.hello = hello(setup, setup.plant.contact.stiffness)
        self._events = PlantEvents(setup)
        self._clipped: list[np.ndarray] = []  # flags since the last block of truth
        self._flags_first = 0
        self.in_ring = False  # whether samples are also put into shared memory
        self._every_s, self._next_s = every_s, 0.0  # no block is due before `_next_s`

    @property
    def step(self) -> int:
        """Present step."""
        return int(self.plant.state.counts[STEP])

    @property
    def boundary(self) -> int:
        """The next step at which a block may end."""
        return min((self.step // BLOCK_STEPS + 1) * BLOCK_STEPS, self.setup.run.steps)

    @property
    def at_boundary(self) -> bool:
        """Whether a block may end at the present step."""
        return self.step % BLOCK_STEPS == 0 or self.step == self.setup.run.steps

    @property
    def due(self) -> bool:
        """Whether a block is due: time has passed, the run is over, or there is no room."""
        counts = self.unsent.counts
        room = ROOM_STEPS - int(counts[TRUTH_END] - counts[TRUTH_FIRST])
        last = self.step == self.setup.run.steps
        return last or room < BLOCK_STEPS or time.monotonic() >= self._next_s

    def announce_run(self) -> None:
        """Announce the run.

        The hello must fit into the memory of a microcontroller. If it lacks the contents of files,
        the whole scene is sent before it; the text of the law goes to the recorder alone.
        """
        if (whole := to_toml(self.setup.scene)) != self.hello.scene_toml:
            self.publisher.send("scene", SceneText(scene_toml=whole))
        self.publisher.send("hello", self.hello)
        if source := loaded_law(self.setup).source:
            self.publisher.send("law", LawText(source=source))

    def samples_waiting(self) -> int:
        """Return the number of samples that were taken and not sent."""
        counts = self.unsent.counts
        return int(counts[SAMPLES_END] - counts[SAMPLES_FIRST])

    def send_samples(self) -> None:
        """Publish the waiting samples, if there are any."""
        count, counts = self.samples_waiting(), self.unsent.counts
        if not count:
            return
        model, every = self.sensor.model, self.sensor.spec.every_steps
        clipped = self.unsent.clipped[:count].astype(np.uint8)
        header = DaqBlock(
            first_step=int(counts[SAMPLES_FIRST]) * every,
            step_ns=self.setup.run.step_ns,
            every_steps=every,
            scale=model.scale,
            offset=model.offset,
            saturated=clipped.tobytes() if model.limited else b"",
            checksum=crc32(self.unsent.values[:count]) if self.in_ring else 0,
        )
        arrays = (
            {"value": self.unsent.values[:count]}
            if model.ideal
            else {"code": self.unsent.codes[:count]}
        )
        self.publisher.send("daq", header, arrays)
        self._clipped.append(clipped)
        counts[SAMPLES_FIRST] += count

    def send_truth(self, until: int | None = None) -> None:
        """Publish the waiting time series and their events.

        The samples of these steps must have been sent.

        Args:
            until: Publish the steps before this one; None: all.
        """
        counts = self.unsent.counts
        first, taken = int(counts[TRUTH_FIRST]), int(counts[TRUTH_END])
        end = taken if until is None else until
        if first == end:
            return
        truth = self.unsent.truth[:, : end - first]
        arrays = truth_columns(truth, self.setup, self.plant.spec.same_point)
        if self._held_steps is not None:
            arrays["held_steps"] = self._held_steps[first:end]
        header = TruthBlock(first_step=first, step_ns=self.setup.run.step_ns)
        self.publisher.send("truth", header, arrays)
        # Flags of samples up to here; a later sample belongs to the next block.
        flags = np.concatenate([np.empty(0, np.uint8), *self._clipped])
        share = -(-end // self.sensor.spec.every_steps) - self._flags_first
        for found in self._events.of(
            first,
            above_dent_m(self.plant.spec.contact, truth[XI], truth[DEEPEST]),
            self._flags_first,
            flags[:share],
        ):
            self.publisher.send("events/plant", found)
        self._clipped, self._flags_first = [flags[share:]], self._flags_first + share
        self.unsent.truth[:, : taken - end] = self.unsent.truth[:, end - first : taken - first]
        counts[TRUTH_FIRST], self._next_s = end, time.monotonic() + self._every_s

    def finish(self) -> None:
        """Publish the energy balance and the counts."""
        plant = self.plant
        closed = plant.close_balance()
        header = EnergyBalance(
            **vars(closed),
            frequencies=len(plant.modes.omega),
            frequency_limit_hz=plant.spec.frequency_limit_hz,
            expected_error=self.setup.expected_error,
        )
        self.publisher.send("balance", header)
        self.publisher.end()

    def fail(self, sentence: str) -> None:
        """Publish what is waiting, and then why the run ends here.

        A dead bus is not a second fault, nor is a block that holds the fault itself. If a role is
        gone, the others receive the end alone.
        """
        failure = event(
            "plant",
            self.step,
            self.setup.run.step_ns,
            Log.FATAL,
            kind=EventKind.RUN_FAILED,
            message=sentence,
        )
        final_messages: tuple[Callable[[], object], ...] = (
            self.send_samples,
            self.send_truth,
            lambda: self.publisher.send("events/plant", failure),
        )
        with suppress(BusError):
            for send in final_messages:
                with suppress(StreamFault):
                    send()
        with suppress(BusError):
            self.publisher.end(fault=sentence)
