"""The plant's side of the exchange: run as far as forces are known, send, wait, go on."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hertzloop.bus.messages_pb2 import RunEnd
from hertzloop.bus.port import BusError, EndedByOther, Port, Publisher, new_run_id, say_every_s
from hertzloop.bus.sequence_checker import SequenceChecker
from hertzloop.bus.streams import CONTROLLER, PLANT, StreamFault
from hertzloop.loop import kernels as loop_kernels
from hertzloop.loop.answers import ForceBuffer, LaneOffer, Repeat, controllers_fault
from hertzloop.loop.kernels import EXCHANGES, MUST_WAIT, SAMPLES_FIRST, SILENT
from hertzloop.loop.plant_streams import PlantStreams
from hertzloop.scene.setup import Setup

_AHEAD_SAMPLES = 64_000  # that may be on their way while the controller has promised zero


@dataclass(frozen=True)
class LoopStats:
    """Which run it was and how it went in wall time; never part of a compared stream."""

    wall_s: float
    exchanges: int
    run_id: str  # as the recording gives it
    lane: str = ""  # what became of the fast lane: a LaneAnswer's name, "" if none was offered


class PlantNode:
    """Runs a scene through a port, in lock-step with the controller at its other end.

    `horizon` is the largest number of steps between two exchanges; None leaves it to what
    the controller grants. With `fast_lane` a controller on this host may answer in shared memory.
    Both change the speed and the blocks, never a sample. With `repeat` the commands of that run
    act, and the controller has to give the same forces.
    """

    def __init__(
        self,
        setup: Setup,
        port: Port,
        horizon: int | None = None,
        timeout_s: float = 10.0,
        on_progress: Callable[[int], None] = lambda step: None,
        fast_lane: bool = False,
        repeat: Repeat | None = None,
        held: np.ndarray | None = None,
        every_s: float = 0.0,
    ) -> None:
        """`held` and `every_s` as in PlantStreams; the former that of `repeat`, if there is one."""
        self.setup, self.port, self.timeout_s = setup, port, timeout_s
        self.horizon = horizon or math.inf
        self.on_progress = on_progress
        publisher = Publisher(port, new_run_id())
        self.streams = PlantStreams(setup, publisher, repeat.held if repeat else held, every_s)
        self.answers = ForceBuffer(setup, self.streams.window, held)
        self._repeat, self._commands = repeat, self.answers.forces
        if repeat:
            self._commands, self.streams.hello.repeats = repeat.commands, repeat.run_id
        self._lane: LaneOffer | None = None
        if fast_lane:
            run_id, every = publisher.run_id, setup.every_steps
            self._lane = LaneOffer(self.streams.hello, run_id, every, self.answers, timeout_s)
        self.checker = SequenceChecker(publisher.run_id, setup.step_ns, PLANT, self.streams.hello)
        self.controller_ended = False
        self.exchanges = 0
        self._advance(0)  # loads the kernels before the clock starts
        self._settle()

    def _advance(self, end: int) -> int:
        streams, answers = self.streams, self.answers
        said = loop_kernels.advance(
            streams.plant.model, streams.plant.state, streams.sensor.model, streams.sensor.state,
            answers.forces, self._commands, streams.window, answers.grant, answers.lane, end,
        )  # fmt: skip
        return self._checked(int(said))

    def _settle(self) -> int:
        streams, answers = self.streams, self.answers
        said = loop_kernels.settle(
            streams.plant.state, answers.forces, streams.window, answers.grant, answers.lane
        )
        return self._checked(int(said))

    def _checked(self, said: int) -> int:
        return self._lane.checked(said) if self._lane else said

    def run(self) -> LoopStats:
        """The whole run. Raises BusError or StreamFault; says so on the bus first."""
        try:
            self.streams.greet()
            started = time.perf_counter()
            self._loop()
            self._await_end()
            self._say_how()
            self.streams.finish()  # the last message waits until all are sent
            wall_s = time.perf_counter() - started
        except (BusError, StreamFault) as error:
            self.streams.fail(f"run ended at step {self.streams.step}: {error}")
            raise
        finally:
            if self._lane:
                self._lane.leave()
        lane = self._lane.became if self._lane else ""
        exchanges = self.exchanges + int(self.answers.grant.counts[EXCHANGES])
        return LoopStats(wall_s, exchanges, f"{self.streams.publisher.run_id:x}", lane)

    def _loop(self) -> None:
        streams, steps = self.streams, self.setup.steps
        last_exchange, told_s = 0, time.monotonic()
        every_s = say_every_s(self.timeout_s)
        while streams.step < steps:
            said = self._advance(int(min(streams.boundary, last_exchange + self.horizon)))
            must_wait = said == MUST_WAIT
            # A slow run is not to be taken for a dead one.
            overdue = time.monotonic() - told_s > every_s
            if said != SILENT or overdue:
                if streams.step >= last_exchange + self.horizon:
                    must_wait, last_exchange = True, streams.step
                due = overdue or streams.due
                if due or must_wait:
                    streams.send_samples()
                if due and (overdue or streams.at_boundary):
                    streams.send_truth()
                    self.on_progress(streams.step)
                    told_s = time.monotonic()
                if must_wait or self._sent() - self.answers.samples > _AHEAD_SAMPLES:
                    self._exchange()
            while self.port.pending():
                self._take()

    def _await_end(self) -> None:
        """Wait for all answers and the controller's end: what it heard and worked by is compared
        before the plant's own end says that the run was as announced."""
        self._await_answers()
        while not self.controller_ended:
            self._take()

    def _say_how(self) -> None:
        """What is to be said of a run that went well, beside its balance."""

    def _sent(self) -> int:
        return int(self.streams.window.counts[SAMPLES_FIRST])

    def _await_answers(self) -> None:
        """Wait until the controller has answered all samples sent."""
        while self.answers.samples < self._sent():
            if not self.answers.in_lane:
                self._take()
            elif self._settle() == SILENT:
                while self.port.pending():
                    self._take()

    def _exchange(self) -> None:
        self.exchanges += 1
        self._await_answers()
        if self.answers.missing_at(self.streams.step):
            raise StreamFault(
                f"the controller has seen all {self.answers.samples} samples, but granted no "
                f"force for step {self.streams.step}"
            )

    def _take(self) -> None:
        """Receive one message of the controller. Raises StreamFault when it cannot be."""
        awaited = f"the force for step {self.answers.end}"
        if self.answers.end == self.setup.steps:
            awaited = "the end"
        envelope = self.port.receive(self.timeout_s, f"{awaited} from the controller", [CONTROLLER])
        block = self.checker.accept(envelope)
        if envelope.stream == "end/controller":
            self._hear_end(block.header)
        elif self.answers.in_lane:
            self._advance(self.streams.step)  # what is in the lane came before
            try:
                self.answers.confirm(block.header, block.arrays["force_n"])
            except StreamFault as error:
                raise controllers_fault(self.port, self.checker, self.timeout_s) or error from None
        else:
            self.answers.take(block.header, block.arrays["force_n"], self.streams.step)
            if self._lane:
                self._lane.hear(block.header.lane, self._sent())

    def _hear_end(self, end: RunEnd) -> None:
        self.controller_ended = True
        self._advance(self.streams.step)  # takes what is left in the lane
        if end.fault or self.answers.end < self.setup.steps:
            raise EndedByOther(f"the controller ended the run: {end.fault or 'too early'}")
        self.checker.reconcile(end)
        if not self.answers.all_confirmed():
            raise StreamFault("stream 'force' ended before it held all that the lane brought")
        if self._repeat:
            self._repeat.compare(self.answers.forces)
