"""The plant's side of the exchange: run as far as forces are known, send samples, wait, go on."""

import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from hertzloop.bus.lane_kernels import WAITED_NS
from hertzloop.bus.messages_pb2 import RunEnd
from hertzloop.bus.port import BusError, EndedByOther, Port, Publisher, new_run_id, say_every_s
from hertzloop.bus.sequence_checker import SequenceChecker
from hertzloop.bus.streams import CONTROLLER, PLANT, StreamFault
from hertzloop.loop import kernels as loop_kernels
from hertzloop.loop.force_buffer import ForceBuffer
from hertzloop.loop.kernels import EXCHANGES, MUST_WAIT, SAMPLES_FIRST, SILENT
from hertzloop.loop.plant_lane import PlantLane
from hertzloop.loop.plant_streams import PlantStreams
from hertzloop.loop.repeated_run import RepeatedRun
from hertzloop.scene.setup import Setup

_AHEAD_SAMPLES = 64_000  # unanswered samples, at most, while the controller has promised zero
_NOTICE_S = 1.0  # in which a controller that fails announces its end


@dataclass(frozen=True)
class LoopStats:
    """Number of a run and its progress in wall time; never part of a compared stream.

    Attributes:
        wall_s: Wall time of the run.
        exchanges: How often the plant waited for a force.
        run_id: Number of the run, as the recording gives it.
        lane: Name of the controller's LaneAnswer; "" if no shared memory was offered.
        waited_s: Part of the wall time in which the plant waited.
    """

    wall_s: float
    exchanges: int
    run_id: str
    lane: str = ""
    waited_s: float = 0.0


@dataclass(frozen=True)
class ExchangeOptions:
    """How a plant exchanges samples and forces with a controller. Nothing here changes a sample.

    Attributes:
        horizon: Most steps between two exchanges. None: as many as the controller grants.
        timeout_s: Longest silence of the controller, s.
        wait_s: The same before its first answer, for which it may compile its law, s.
        fast_lane: Whether shared memory is offered to a controller on this host.
        every_s: Least wall time between two blocks of a stream, s.
    """

    horizon: int | None = None
    timeout_s: float = 10.0
    wait_s: float = 0.0
    fast_lane: bool = False
    every_s: float = 0.0


USUAL_EXCHANGE = ExchangeOptions()


class PlantNode:
    """Runs a scene through a port, in lock-step with the controller at its other end."""

    def __init__(
        self,
        setup: Setup,
        port: Port,
        exchange: ExchangeOptions = USUAL_EXCHANGE,
        on_progress: Callable[[int], None] = lambda step: None,
        repeat: RepeatedRun | None = None,
        held_steps: np.ndarray | None = None,
    ) -> None:
        """
        Args:
            setup: Setup of the run.
            port: Port to controller and recorder.
            exchange: How samples and forces are exchanged.
            on_progress: Called with the number of finished steps.
            repeat: A recorded run whose commands act. The controller must send the same forces.
            held_steps: As in `ForceBuffer`. A repeated run is in lock-step, and publishes those of
                the recorded run.
        """
        self.setup, self.port, self.timeout_s = setup, port, exchange.timeout_s
        self.horizon, self._wait_s = exchange.horizon or math.inf, exchange.wait_s
        self.on_progress = on_progress
        publisher = Publisher(port, new_run_id())
        acted = repeat.held_steps if repeat else held_steps
        self.streams = PlantStreams(setup, publisher, acted, exchange.every_s)
        self.buffer = ForceBuffer(setup, self.streams.window, held_steps)
        self._repeat, self._commands = repeat, self.buffer.forces
        if repeat:
            self._commands, self.streams.hello.repeats = repeat.commands, repeat.run_id
        self._lane: PlantLane | None = None
        if exchange.fast_lane:
            self._lane = PlantLane(
                self.streams.hello,
                publisher.run_id,
                setup.sensor.every_steps,
                self.buffer,
                self.timeout_s,
            )
        self.checker = SequenceChecker(
            publisher.run_id, setup.run.step_ns, PLANT, self.streams.hello
        )
        self.controller_ended = False
        self.exchanges = 0
        self._advance(0)  # loads the kernels before the clock starts
        self._wait_in_lane()

    def run(self) -> LoopStats:
        """Run the scene.

        Raises:
            BusError, StreamFault: The run has failed; the other roles were told.
        """
        try:
            self.streams.announce_run()
            started = time.perf_counter()
            self._loop()
            self._wait_for_end()
            self._publish_statistics()
            self.streams.finish()  # the last message waits until all are sent
            wall_s = time.perf_counter() - started
        except (BusError, StreamFault) as error:
            self.streams.fail(f"run ended at step {self.streams.step}: {error}")
            raise
        finally:
            if self._lane:
                self._lane.leave()
        lane = self._lane.outcome if self._lane else ""
        exchanges = self.exchanges + int(self.buffer.grant.counts[EXCHANGES])
        run_id = f"{self.streams.publisher.run_id:x}"
        return LoopStats(wall_s, exchanges, run_id, lane, min(self._waited_s(), wall_s))

    def _waited_s(self) -> float:
        """Return the wall time in which the plant has waited for messages and in the lane."""
        return self.port.waited_s + 1e-9 * float(self.buffer.lane.own[WAITED_NS])

    def _loop(self) -> None:
        streams, steps = self.streams, self.setup.run.steps
        last_exchange, last_sent_s = 0, time.monotonic()
        every_s = say_every_s(self.timeout_s)
        while streams.step < steps:
            status = self._advance(int(min(streams.boundary, last_exchange + self.horizon)))
            must_wait = status == MUST_WAIT
            # Others must not take a slow run for a dead one.
            overdue = time.monotonic() - last_sent_s > every_s
            if status != SILENT or overdue:
                if streams.step >= last_exchange + self.horizon:
                    must_wait, last_exchange = True, streams.step
                due = overdue or streams.due
                if due or must_wait:
                    streams.send_samples()
                if due and (overdue or streams.at_boundary):
                    streams.send_truth()
                    self.on_progress(streams.step)
                    last_sent_s = time.monotonic()
                if must_wait or self._samples_sent() - self.buffer.samples > _AHEAD_SAMPLES:
                    self._exchange()
            while self.port.pending():
                self._receive()

    def _advance(self, end: int) -> int:
        """Run to step `end`, or as far as forces are known; return the status of the kernel."""
        streams, buffer = self.streams, self.buffer
        status = int(
            loop_kernels.advance(
                streams.plant.model,
                streams.plant.state,
                streams.sensor.model,
                streams.sensor.state,
                buffer.forces,
                self._commands,
                streams.window,
                buffer.grant,
                buffer.lane,
                end,
            )
        )
        if self._lane:
            self._lane.check(status)
        return status

    def _wait_in_lane(self) -> int:
        """Wait in shared memory until all samples are answered; return the kernel's status."""
        streams, buffer = self.streams, self.buffer
        status = int(
            loop_kernels.await_answers(
                streams.plant.state, buffer.forces, streams.window, buffer.grant, buffer.lane
            )
        )
        if self._lane:
            self._lane.check(status)
        return status

    def _samples_sent(self) -> int:
        return int(self.streams.window.counts[SAMPLES_FIRST])

    def _exchange(self) -> None:
        """Wait for all answers. Raises StreamFault if the next force is still not known."""
        self.exchanges += 1
        self._wait_for_answers()
        if self.buffer.missing_at(self.streams.step):
            raise StreamFault(
                f"the controller has seen all {self.buffer.samples} samples, but granted no "
                f"force for step {self.streams.step}"
            )

    def _wait_for_answers(self) -> None:
        """Wait until the controller has answered all samples sent."""
        while self.buffer.samples < self._samples_sent():
            if not self.buffer.uses_lane:
                self._receive()
            elif self._wait_in_lane() == SILENT:
                while self.port.pending():
                    self._receive()

    def _wait_for_end(self) -> None:
        """Wait for all answers and the controller's end.

        Both sides compare what they counted before the plant announces its own end.
        """
        self._wait_for_answers()
        while not self.controller_ended:
            self._receive()

    def _publish_statistics(self) -> None:
        """Publish what else is known of a run that has succeeded; nothing in lock-step."""

    def _receive(self) -> None:
        """Receive one message of the controller. Raises StreamFault if it is impossible."""
        awaited = f"the force for step {self.buffer.end}"
        if self.buffer.end == self.setup.run.steps:
            awaited = "the end"
        # The controller may compile its law before it answers for the first time.
        timeout_s = self.timeout_s if self.buffer.samples else max(self.timeout_s, self._wait_s)
        envelope = self.port.receive(timeout_s, f"{awaited} from the controller", [CONTROLLER])
        block = self.checker.accept(envelope)
        if envelope.stream == "end/controller":
            self._receive_end(block.header)
        elif self.buffer.uses_lane:
            self._advance(self.streams.step)  # forces in the lane are older than this message
            try:
                self.buffer.confirm(block.header, block.arrays["force_n"])
            except StreamFault as error:
                raise self._fault_of_controller() or error from None
        else:
            self.buffer.receive(block.header, block.arrays["force_n"], self.streams.step)
            if self._lane:
                self._lane.receive_answer(block.header.lane, self._samples_sent())

    def _receive_end(self, end: RunEnd) -> None:
        self.controller_ended = True
        self._advance(self.streams.step)  # takes the rest from the lane
        if end.fault or self.buffer.end < self.setup.run.steps:
            raise EndedByOther(f"the controller ended the run: {end.fault or 'too early'}")
        self.checker.reconcile(end)
        if not self.buffer.all_confirmed():
            raise StreamFault("stream 'force' ended before it held all that the lane brought")
        if self._repeat:
            self._repeat.compare(self.buffer.forces)

    def _fault_of_controller(self) -> EndedByOther | None:
        """Return the fault that the controller is about to announce, or None.

        A controller that fails may publish forces that it could not put into shared memory.
        """
        with suppress(BusError, StreamFault):
            while True:
                envelope = self.port.receive(min(self.timeout_s, _NOTICE_S), "the end")
                block = self.checker.accept(envelope)
                if envelope.stream == "end/controller":
                    fault = block.header.fault
                    return EndedByOther(f"the controller ended the run: {fault}") if fault else None
        return None
