"""The plant's side: run as far as forces are known, send samples, wait, go on."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hertzloop.bus.messages_pb2 import RunEnd
from hertzloop.bus.port import (
    BusError,
    EndedByOther,
    PeerLost,
    Publisher,
    new_run_id,
    say_every_s,
)
from hertzloop.bus.ring_kernels import OPEN
from hertzloop.bus.sequence_checker import SequenceChecker
from hertzloop.bus.streams import CONTROLLER, PLANT, StreamFault
from hertzloop.closed_loop import clock as clocks
from hertzloop.closed_loop import grant as grants
from hertzloop.closed_loop import loop
from hertzloop.closed_loop.exchange import (
    ANSWERED,
    ANSWERS_NEEDED,
    BEGAN_NS,
    CLOCK,
    EXCHANGES,
    FORCES_END,
    LOCK_STEP,
    OBSERVED,
    SAMPLES_END,
    SAMPLES_FIRST,
    Status,
)
from hertzloop.closed_loop.parts import NO_CLOCK, elsewhere, exchange, plant_side
from hertzloop.common.protocols import Port
from hertzloop.common.uncompiled import plain
from hertzloop.loop.paced import REST_S, Paced
from hertzloop.loop.plant_exchange import (
    SharedMemory,
    accept_block,
    check_forces,
    fault_in_ring,
)
from hertzloop.loop.plant_streams import PlantStreams
from hertzloop.loop.repeated_run import RepeatedRun
from hertzloop.loop.run_options import USUAL_RUN, RunOptions
from hertzloop.scene.setup import Setup

# Interpreted: once a message, compiling it for that would only lengthen the first run.
_is_known, _note_answers = plain(grants.is_known), plain(clocks.note_answers)
_AHEAD_SAMPLES = 64_000  # unanswered samples, at most, while the force is zero until the trigger


@dataclass(frozen=True)
class LoopStats:
    """Number of a run and its progress in wall time; never part of a compared stream.

    Attributes:
        wall_s: Wall time of the run.
        exchanges: How often the plant waited for a force.
        run_id: Number of the run, as the recording gives it.
        shared_memory: Name of the controller's answer; "" if none was offered.
    """

    wall_s: float
    exchanges: int
    run_id: str
    shared_memory: str = ""


class PlantNode:
    """Runs a scene through a port, in lock-step with the controller at its other end or at a pace.

    Attributes:
        exchange: What the compiled loop takes.
        exchanges: How often the plant waited for a force from the bus.
    """

    def __init__(
        self,
        setup: Setup,
        port: Port,
        options: RunOptions = USUAL_RUN,
        on_progress: Callable[[int], None] = lambda step: None,
        repeat: RepeatedRun | None = None,
        *,
        wait_s: float = 0.0,
        every_s: float = 0.0,
    ) -> None:
        """
        Args:
            setup: Setup of the run.
            port: Port to controller and recorder.
            options: How samples and forces are exchanged; `timeout_s` is the longest silence of the
                controller. Without `pace` nothing there changes a sample.
            on_progress: Called with the number of finished steps.
            repeat: A recorded run whose commands act, in lock-step. The controller must send the
                same forces.
            wait_s: Longest silence before the controller's first answer, for which it may compile
                its law, s.
            every_s: Least wall time between two blocks of a stream, s.

        Raises:
            SceneError: The processes would time out at this pace.
        """
        self.setup, self.port, self.timeout_s = setup, port, options.timeout_s
        self.on_progress, self._repeat = on_progress, repeat
        self._wait_s, self._max_steps = wait_s, options.max_exchange_steps or math.inf
        self._paced = Paced(setup, options.pace, self.timeout_s) if options.pace else None
        clock = self._paced.clock if self._paced else NO_CLOCK
        self.exchange = exchange(
            LOCK_STEP,
            elsewhere(np.zeros(setup.run.steps)),
            commands=repeat.commands if repeat else None,
            loop_delay_steps=1 + setup.signal_path.latency_steps,
            clock=clock,
        )
        publisher = Publisher(port, new_run_id())
        held = repeat.held_steps if repeat else clock.held_steps if self._paced else None
        self.streams = PlantStreams(setup, publisher, held, every_s)
        hello = self.streams.hello
        hello.pace, hello.repeats = options.pace or 0.0, repeat.run_id if repeat else 0
        self._memory: SharedMemory | None = None
        if options.shared_memory:
            self._memory = SharedMemory(hello, publisher.run_id, setup.sensor.every_steps)
        self._answered, self._answered_s = -1, 0.0  # at the latest change, and when
        self.checker = SequenceChecker(publisher.run_id, setup.run.step_ns, PLANT, hello)
        self.controller_ended = False
        self.exchanges = 0
        self._side = plant_side(self.streams.plant, self.streams.sensor)
        self._run_to(0)  # loads the kernel before the clock starts

    @property
    def in_ring(self) -> bool:
        """Whether samples and forces are exchanged in shared memory."""
        return bool(self.exchange.ring.own[OPEN])

    @property
    def answered(self) -> int:
        """Number of samples that the controller has answered."""
        return int(self.exchange.counts[ANSWERED])

    @property
    def forces_end(self) -> int:
        """Number of steps whose force was received."""
        return int(self.exchange.counts[FORCES_END])

    @property
    def _samples_sent(self) -> int:
        return int(self.streams.unsent.counts[SAMPLES_FIRST])

    def run(self) -> LoopStats:
        """Run the scene.

        Raises:
            BusError, StreamFault: The run has failed; the other roles were told.
        """
        streams = self.streams
        try:
            streams.announce_run()
            started = time.perf_counter()
            if self._paced:
                self._follow_clock(self._paced)
            else:
                self._go_in_lock_step()
            self._wait_for_answers()
            while not self.controller_ended:  # both compare what they counted
                self._receive()
            if self._paced:
                header, arrays = self._paced.statistics(self.exchange)
                streams.publisher.send("pacing", header, arrays)
            streams.finish()  # the last message waits until all are sent
            wall_s = time.perf_counter() - started
        except (BusError, StreamFault) as error:
            streams.fail(f"run ended at step {streams.step}: {error}")
            raise
        finally:
            if self._memory:
                self._memory.leave(self.exchange)
        outcome = self._memory.outcome if self._memory else ""
        exchanges = self.exchanges + int(self.exchange.counts[EXCHANGES])
        run_id = f"{streams.publisher.run_id:x}"
        return LoopStats(wall_s, exchanges, run_id, outcome)

    def _go_in_lock_step(self) -> None:
        streams, steps = self.streams, self.setup.run.steps
        last_exchange, last_sent_s = 0, time.monotonic()
        every_s = say_every_s(self.timeout_s)
        while streams.step < steps:
            status = self._run_to(int(min(streams.boundary, last_exchange + self._max_steps)))
            must_wait = status is Status.MUST_WAIT
            # Others must not take a slow run for a dead one.
            overdue = time.monotonic() - last_sent_s > every_s
            if status is not Status.SILENT or overdue:
                if streams.step >= last_exchange + self._max_steps:
                    must_wait, last_exchange = True, streams.step
                due = overdue or streams.due
                if due or must_wait:
                    streams.send_samples()
                if due and (overdue or streams.at_boundary):
                    streams.send_truth()
                    self.on_progress(streams.step)
                    last_sent_s = time.monotonic()
                if must_wait or self._samples_sent - self.answered > _AHEAD_SAMPLES:
                    self._wait_for_force()
            while self.port.pending():
                self._receive()

    def _follow_clock(self, paced: Paced) -> None:
        """Take every step when it is due. The first sample is exchanged in lock-step."""
        streams, steps = self.streams, self.setup.run.steps
        self._run_to(1)
        streams.send_samples()
        while not self.answered:
            self._receive()
        self.exchange = paced.started(self.exchange, streams.step)
        sent_s, every_s = time.monotonic(), say_every_s(self.timeout_s)
        while streams.step < steps:
            status = self._run_to(streams.boundary)
            if status is Status.REACHED or time.monotonic() - sent_s > every_s:
                end = streams.step
                streams.send_samples()
                if self.in_ring:
                    # A message takes a good part of a millisecond. A step that is due must not wait
                    # for two, nor its sample for an answer that has arrived.
                    self._run_to(min(end + 1, steps))
                streams.send_truth(end)
                self.on_progress(end)
                sent_s = time.monotonic()
            elif not self.in_ring:
                streams.send_samples()
            while self.port.pending():
                self._receive()
            self._check_patience()
            if status is Status.SILENT and not self.in_ring:
                paced.rest(streams.step, self.port.pending)

    def _run_to(self, end: int, answers_needed: int = 0) -> Status:
        """Run to step `end`, or as far as the exchange lets it.

        Raises:
            StreamFault: Shared memory holds something impossible, or the controller cannot follow.
            PeerLost: The controller has been silent for too long.
        """
        counts = self.exchange.counts
        counts[BEGAN_NS], counts[ANSWERS_NEEDED] = time.monotonic_ns(), answers_needed
        status = Status(int(loop.run(self._side, self.exchange, self.streams.unsent, end)))
        if status is Status.FULL:
            raise StreamFault(
                f"the controller has not answered {len(self.exchange.clock.values):,} samples: it "
                "cannot follow. Use a lower --pace."
            )
        if status > Status.FULL:
            raise StreamFault(fault_in_ring(status, self.exchange))
        if status is Status.SILENT and not self._paced:
            self._check_patience()
        return status

    def _check_patience(self) -> None:
        """Raise PeerLost if samples wait in shared memory, or at a pace, for too long."""
        if self._paced:
            silent_s = self._paced.unanswered_s(self.exchange, self.streams.unsent)
        else:
            if self.answered != self._answered:
                self._answered, self._answered_s = self.answered, time.monotonic()
            silent_s = time.monotonic() - self._answered_s
        if silent_s > self.timeout_s:
            where = " in the ring" if self.in_ring else ""
            raise PeerLost(
                f"plant waited {self.timeout_s:g} s for the force for step {self.forces_end} from "
                f"the controller: nothing came{where}",
                CONTROLLER,
            )

    def _wait_for_force(self) -> None:
        """Wait for all answers. Raises StreamFault if the next force is still not known."""
        self.exchanges += 1
        self._wait_for_answers()
        step, unsent = self.streams.step, self.streams.unsent
        observed = unsent.counts[OBSERVED] > step
        if observed and step < self.setup.run.steps and not _is_known(self.exchange.grant, step):
            raise StreamFault(
                f"the controller has seen all {self.answered} samples, but granted no force for "
                f"step {step}"
            )

    def _wait_for_answers(self) -> None:
        """Wait until the controller has answered all samples sent."""
        while self.answered < self._samples_sent:
            if not self.in_ring:
                self._receive()
                continue
            self._run_to(self.streams.step, int(self.streams.unsent.counts[SAMPLES_END]))
            if self.answered < self._samples_sent:
                self._check_patience()
                if self._paced:
                    time.sleep(REST_S)
                while self.port.pending():
                    self._receive()

    def _receive(self) -> None:
        """Receive one message of the controller. Raises StreamFault if it is impossible."""
        awaited = f"the force for step {self.forces_end}"
        if self.forces_end == self.setup.run.steps:
            awaited = "the end"
        # The controller may compile its law before it answers for the first time.
        timeout_s = self.timeout_s if self.answered else max(self.timeout_s, self._wait_s)
        envelope = self.port.receive(timeout_s, f"{awaited} from the controller", [CONTROLLER])
        block = self.checker.accept(envelope)
        if self.in_ring:
            self._run_to(self.streams.step)  # what is in the ring is older than this message
        if envelope.stream == "end/controller":
            self._receive_end(block.header)
            return
        forces = block.arrays["force_n"]
        if self.in_ring:
            check_forces(self.exchange, block.header, len(forces))
            return
        step, unsent = self.streams.step, self.streams.unsent
        accept_block(self.exchange, unsent, block.header, forces, step)
        if self.exchange.kind == CLOCK:
            now, counts = time.monotonic_ns(), self.exchange.counts
            _note_answers(self.exchange.clock, now, counts[ANSWERED], counts[FORCES_END])
        if self._memory:
            answer, sent = block.header.shared_memory, self._samples_sent
            self.exchange = self._memory.receive_answer(answer, self.exchange, sent)
            self.streams.in_ring = self.in_ring

    def _receive_end(self, end: RunEnd) -> None:
        self.controller_ended = True
        if end.fault or self.forces_end < self.setup.run.steps:
            raise EndedByOther(f"the controller ended the run: {end.fault or 'too early'}")
        self.checker.reconcile(end)
        if self.checker.next_step.get("force", 0) != self.forces_end:
            raise StreamFault("stream 'force' ended before it held all that the ring brought")
        if self._repeat:
            self._repeat.compare(self.exchange.controller.forces)
