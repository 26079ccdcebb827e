"""A plant that follows the wall clock: it takes every step when it is due, and waits for no force.

The force of step k acts if it has arrived when the step is taken; otherwise the newest force that
has arrived acts (`follow` in pace_kernels.py). See docs/how-to/paced.md.
"""

import math
import time
from collections.abc import Callable

import numpy as np

from hertzloop.bus.lane import sleep_precisely
from hertzloop.bus.messages_pb2 import Pacing
from hertzloop.bus.port import PeerLost, Port, say_every_s
from hertzloop.bus.streams import StreamFault
from hertzloop.loop import pace_kernels
from hertzloop.loop.kernels import REACHED, SAMPLES_END, SILENT
from hertzloop.loop.plant_lane import fault_in_lane
from hertzloop.loop.plant_node import USUAL_EXCHANGE, ExchangeOptions, PlantNode
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup

_MOST_WAITING = 1 << 22  # samples that are not answered
_REST_S = 50e-6


def check_pace(setup: Setup, pace: float, timeout_s: float) -> None:
    """Raise SceneError for a pace (simulated over wall time) at which processes that wait
    `timeout_s` for a message would take each other for dead."""
    sample_s, most_s = setup.run.step_s * setup.sensor.every_steps, timeout_s / 4
    if not sample_s <= most_s * pace:  # nor at a pace of nan
        every_s = sample_s / pace if pace > 0.0 else math.inf
        raise SceneError(
            f"a pace of {pace:g} brings a sample every {every_s:.3g} s, but the processes wait "
            f"{timeout_s:g} s for each other: use a pace of {sample_s / most_s:.2g} or more, or a "
            "longer --timeout"
        )


def _pace(setup: Setup, pace: float) -> pace_kernels.Pace:
    """What a run at a pace keeps, at its start."""
    room = 1 << min(_MOST_WAITING, setup.run.steps // setup.sensor.every_steps + 1).bit_length()
    return pace_kernels.Pace(
        held=np.zeros(setup.run.steps, np.int32),
        values=np.zeros(room),
        taken_ns=np.zeros(room, np.int64),
        counts=np.zeros(pace_kernels.PACE_COUNTS, np.int64),
        histogram=np.zeros(pace_kernels.CLASSES, np.int64),
        step_ns=setup.run.step_ns / pace,
    )


class PacedPlantNode(PlantNode):
    """A plant that follows the wall clock.

    The first sample is exchanged in lock-step, which sets up the lane. The clock starts with the
    answer to it.
    """

    def __init__(
        self,
        setup: Setup,
        port: Port,
        pace: float,
        exchange: ExchangeOptions = USUAL_EXCHANGE,
        on_progress: Callable[[int], None] = lambda step: None,
    ) -> None:
        """As `PlantNode`, with `pace`: simulated over wall time.

        Raises:
            SceneError: The processes would time out at this pace.
        """
        check_pace(setup, pace, exchange.timeout_s)
        self._pace = _pace(setup, pace)
        super().__init__(setup, port, exchange, on_progress, held_steps=self._pace.held)
        self.streams.hello.pace = pace
        super()._advance(0)
        pace_kernels.note_answers(self._pace, 0, 0, 0)
        pace_kernels.note_forces(self._pace, 0, 0, 0)

    def _advance(self, end: int) -> int:
        streams, buffer = self.streams, self.buffer
        status = int(
            pace_kernels.follow(
                streams.plant.model,
                streams.plant.state,
                streams.sensor.model,
                streams.sensor.state,
                buffer.forces,
                streams.window,
                buffer.grant,
                buffer.lane,
                self._pace,
                end,
            )
        )
        if status == pace_kernels.FULL:
            raise StreamFault(
                f"the controller has not answered {len(self._pace.values):,} samples: it cannot "
                "follow. Use a lower --pace."
            )
        if status > SILENT:
            raise StreamFault(fault_in_lane(status, buffer))
        return status

    def _wait_in_lane(self) -> int:
        self._advance(self.streams.step)
        if self.buffer.samples == int(self.streams.window.counts[SAMPLES_END]):
            return REACHED
        self._check_patience()
        time.sleep(_REST_S)
        return SILENT

    def _check_patience(self) -> None:
        """Raise PeerLost if a sample has not been answered for too long."""
        first, end = self.buffer.samples, int(self.streams.window.counts[SAMPLES_END])
        ring = self._pace.taken_ns
        waited_ns = time.monotonic_ns() - ring[first % len(ring)]
        if first < end and waited_ns > 1e9 * self.timeout_s:
            raise PeerLost(
                f"plant waited {self.timeout_s:g} s for the force for step {self.buffer.end} from "
                "the controller: nothing came",
                "controller",
            )

    def _loop(self) -> None:
        streams, steps = self.streams, self.setup.run.steps
        super()._advance(1)
        streams.send_samples()
        while not self.buffer.samples:
            super()._receive()
        sleep_precisely()
        self._pace.counts[pace_kernels.PUT] = self.buffer.samples
        self._pace.counts[pace_kernels.START_NS] = time.monotonic_ns() - int(
            streams.step * self._pace.step_ns
        )
        sent_s, every_s = time.monotonic(), say_every_s(self.timeout_s)
        while streams.step < steps:
            status = self._advance(streams.boundary)
            if status == REACHED or time.monotonic() - sent_s > every_s:
                end = streams.step
                streams.send_samples()
                if self.buffer.uses_lane:
                    # A message takes a good part of a millisecond. A step that is due must not wait
                    # for two, nor its sample for an answer that has arrived.
                    self._advance(min(end + 1, steps))
                streams.send_truth(end)
                self.on_progress(end)
                sent_s = time.monotonic()
            elif not self.buffer.uses_lane:
                streams.send_samples()
            while self.port.pending():
                self._receive()
            self._check_patience()
            if status == SILENT and not self.buffer.uses_lane:
                self._rest()

    def _rest(self) -> None:
        """Without a lane, wait until the next step is due or a message arrives."""
        began = time.monotonic_ns()
        due = self._pace.counts[pace_kernels.START_NS] + self.streams.step * self._pace.step_ns
        while not self.port.pending() and time.monotonic_ns() < due - _REST_S * 1e9:
            time.sleep(_REST_S)
        self._pace.counts[pace_kernels.WAITED_NS] += time.monotonic_ns() - began

    def _waited_s(self) -> float:
        """As in lock-step, with the time in which the plant waited for the clock."""
        return super()._waited_s() + 1e-9 * float(self._pace.counts[pace_kernels.WAITED_NS])

    def _receive(self) -> None:
        """As in lock-step. Without a lane, forces from the bus count as answers."""
        if self.buffer.uses_lane:
            super()._receive()
            return
        samples, forces = self.buffer.samples, self.buffer.end
        super()._receive()
        now = time.monotonic_ns()
        pace_kernels.note_answers(self._pace, now, samples, self.buffer.samples)
        pace_kernels.note_forces(self._pace, now, forces, self.buffer.end)

    def _publish_statistics(self) -> None:
        counts = self._pace.counts
        wall_ns = time.monotonic_ns() - int(counts[pace_kernels.START_NS])
        header = Pacing(
            pace=self.streams.hello.pace,
            response_max_ns=int(counts[pace_kernels.RESPONSE_MAX_NS]),
            late_max_ns=int(counts[pace_kernels.LATE_MAX_NS]),
            behind_max_ns=int(counts[pace_kernels.BEHIND_MAX_NS]),
            working_ns=max(0, wall_ns - int(counts[pace_kernels.WAITED_NS])),
            classes_an_octave=pace_kernels.CLASSES_AN_OCTAVE,
            lookahead_steps=self.buffer.grant.lookahead_steps,
            step_ns=self.setup.run.step_ns,
        )
        self.streams.publisher.send(
            "pacing", header, {"answers": np.trim_zeros(self._pace.histogram, "b").astype(float)}
        )
