"""The controller's side of the exchange: receive samples, send forces and promises."""

import time
from contextlib import suppress
from zlib import crc32

import numpy as np

from hertzloop.bus import shared_memory
from hertzloop.bus.codec import DecodedBlock
from hertzloop.bus.messages_pb2 import ControllerReport, DaqBlock, ForceBlock, SharedMemoryAnswer
from hertzloop.bus.port import BusError, PeerLost, Publisher
from hertzloop.bus.ring_kernels import Ring
from hertzloop.bus.sequence_checker import SequenceChecker, compare_report
from hertzloop.bus.streams import CONTROLLER, PLANT, Envelope, StreamFault
from hertzloop.common.protocols import Port
from hertzloop.controller.loading.bound import LawFault
from hertzloop.controller.loading.registry import check_digest
from hertzloop.loop import answering
from hertzloop.loop.announcement import controller_report
from hertzloop.loop.answering import AnswerBlock, Answering
from hertzloop.loop.events import ControllerEvents
from hertzloop.scene.controller import build_controller, loaded_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, parse

# Answers in shared memory are also published over the bus, in blocks that end at multiples of
# _BLOCK samples and are _EVERY_S apart at least.
_BLOCK, _EVERY_S = 1000, 0.01


def sampled_values(block: DecodedBlock) -> np.ndarray:
    """Return the physical values of a DaqBlock, shape (samples,), in the unit of its quantity."""
    codes = block.arrays["code"]
    if not len(codes):
        return np.array(block.arrays["value"], dtype=float)
    with np.errstate(over="ignore", invalid="ignore"):  # the caller refuses what is not finite
        return np.asarray(block.header.offset + block.header.scale * codes)


class ControllerNode:
    """Answers every block of samples with a block of forces; set up by the plant's hello.

    It announces its end once all samples of the run are answered, and is done when the plant has
    announced its own. In shared memory it answers each sample at once, and publishes the forces in
    longer blocks.

    Attributes:
        setup: Setup of the run, as the plant has announced it; None before.
        done: Whether the plant has announced its end.
        fault: The fault with which the plant ended the run, or "".
    """

    def __init__(
        self,
        port: Port,
        commands_ahead: bool = True,
        law: str | None = None,
        shared_memory: bool = True,
    ) -> None:
        """
        Args:
            port: Port to plant and recorder.
            commands_ahead: Send forces as soon as they are known, ahead of their step.
            law: Path of the law on this side, if it is not that of the scene.
            shared_memory: Join shared memory that the plant offers.
        """
        self.port, self._commands_ahead, self._law = port, commands_ahead, law
        self.checker = SequenceChecker(role=CONTROLLER)
        self.done = False
        self.fault = ""
        self.setup: Setup | None = None
        self._shared_memory = shared_memory
        self._offered: Ring | None = None
        self._joined: SharedMemoryAnswer = SharedMemoryAnswer.NOT_STATED
        self._answering: Answering | None = None
        self._publisher: Publisher | None = None
        self._report: ControllerReport | None = None
        self._scene = ""  # the whole scene, if the hello lacks the contents of files
        self._next_block_s = 0.0
        self._samples = 0  # whose answers are published
        answering.load()  # before the plant waits for an answer

    @property
    def samples(self) -> int:
        """Number of samples that were answered."""
        return self._answering.samples if self._answering else 0

    @property
    def law_samples(self) -> int:
        """Number of samples that the law was given."""
        return self._answering.taken if self._answering else 0

    def work(self, timeout_s: float) -> None:
        """Receive what comes next, from the bus or from shared memory.

        Raises:
            StreamFault: The message or the sample is impossible.
            BusError: Nothing has come within `timeout_s`.
        """
        found = self._answering
        if not found or not found.in_ring or (self._publisher and self._publisher.ended):
            self.handle(self.port.receive(timeout_s, "samples from the plant", [PLANT]))
            return
        try:
            found.answer_in_ring((found.taken // _BLOCK + 1) * _BLOCK)
        except LawFault as error:
            raise StreamFault(str(error)) from error
        if found.idle_s > timeout_s:
            raise PeerLost(
                f"controller waited {timeout_s:g} s for samples from the plant: nothing came in "
                "the ring",
                PLANT,
            )
        if self._is_due(found):
            self._publish(found.reply())
        while self.port.pending():
            self.handle(self.port.receive(timeout_s, "samples from the plant", [PLANT]))

    def handle(self, envelope: Envelope) -> None:
        """Receive one message. Raises StreamFault if it is impossible here."""
        try:
            self._receive(envelope)
        except StreamFault as error:
            raise self.checker.explained(error) from error

    def _receive(self, envelope: Envelope) -> None:
        block = self.checker.accept(envelope)
        if envelope.stream == "scene":
            self._scene = block.header.scene_toml
        elif envelope.stream == "hello":
            self._receive_hello(block)
        elif envelope.stream == "daq":
            self._answer(block)
        elif envelope.stream == "end/plant":
            self._end(block)

    def _receive_hello(self, block: DecodedBlock) -> None:
        self._publisher = Publisher(self.port, self.checker.run_id)
        scene = self._scene or block.header.scene_toml
        try:
            setup = parse(scene, law=self._law)
            setup = setup.with_stiffness(block.header.stiffness)
            announced = block.header.law_digest
            law = loaded_law(setup)
            check_digest(str(law.path), law.digest, announced or None)
            self._answering = Answering(build_controller(setup), self._commands_ahead)
        except SceneError as error:
            raise StreamFault(f"the plant announced an invalid scene: {error}") from error
        asked = setup.scene.controller.law  # as the plant calls it, wherever this side has it
        if self._law is not None:
            asked = parse(scene, recorded=True).scene.controller.law
        self._report = controller_report(setup, asked)
        compare_report(block.header, self._report)  # another version may resolve it differently
        if (setup.run.steps, setup.run.step_ns) != (block.header.steps, block.header.step_ns):
            raise StreamFault(
                f"the plant announced {block.header.steps} steps of {block.header.step_ns} ns, its "
                f"scene has {setup.run.steps} of {setup.run.step_ns} ns"
            )
        self.setup = setup
        self._every_steps, self._step_ns = setup.sensor.every_steps, setup.run.step_ns
        self._events = ControllerEvents(setup)
        self._offered, self._joined = shared_memory.join(block.header, self._shared_memory)
        if self._offered is not None and block.header.pace:
            sample_ns = self._every_steps * self._step_ns / block.header.pace
            self._offered = shared_memory.at_pace(self._offered, sample_ns)

    def _answer(self, block: DecodedBlock) -> None:
        found = self._answering
        if found is None:
            raise StreamFault("samples came before the plant announced the run")
        header: DaqBlock = block.header
        if header.every_steps != self._every_steps:
            raise StreamFault(
                f"stream 'daq' sequence {header.sequence} has a sample every {header.every_steps} "
                f"steps, the scene every {self._every_steps}"
            )
        values, total = sampled_values(block), found.total
        first = header.first_step // self._every_steps
        if first + len(values) > total:
            raise StreamFault(f"stream 'daq' sequence {header.sequence} is beyond the run's end")
        if not np.all(np.isfinite(values)):
            raise StreamFault(
                f"stream 'daq' sequence {header.sequence} holds a value that is not finite"
            )
        if found.in_ring:
            found.check_block(header.sequence, first, len(values), header.checksum)
            return
        try:
            found.answer_block(values)
        except LawFault as error:
            raise StreamFault(str(error)) from error
        self._publish(found.reply(), self._joined)
        self._joined = SharedMemoryAnswer.NOT_STATED  # stated once
        if self._offered is not None:
            found.use_ring(self._offered)
            shared_memory.sleep_precisely()

    def _is_due(self, found: Answering) -> bool:
        """Whether answers given in shared memory are to be published, in blocks."""
        answered, now = found.samples, time.monotonic()
        if answered == self._samples or (answered % _BLOCK and answered != found.total):
            return False
        if answered < found.total and not found.full and now < self._next_block_s:
            return False
        self._next_block_s = now + _EVERY_S
        return True

    def _publish(
        self, reply: AnswerBlock, joined: "SharedMemoryAnswer" = SharedMemoryAnswer.NOT_STATED
    ) -> None:
        assert self._publisher is not None
        assert self._answering is not None
        zero = reply.zero_until_trigger
        answer = ForceBlock(
            first_step=reply.first_step,
            step_ns=self._step_ns,
            samples_seen=reply.samples,
            zero_until_trigger=zero,
            trigger_level=reply.trigger_level if zero else 0.0,
            shared_memory=joined,
            checksum=crc32(reply.forces) if self._answering.in_ring else 0,
        )
        self._publisher.send("force", answer, {"force_n": reply.forces})
        for event in self._events.of(self._samples, reply.modes, reply.delays):
            self._publisher.send("events/controller", event)
        self._samples = reply.samples
        if self._samples == self._answering.total:
            self._publisher.end(report=self._report)

    def _end(self, block: DecodedBlock) -> None:
        """Receive the plant's end. Unless the run has failed, compare the counts of both sides."""
        self.done = True
        self.fault = fault = block.header.fault
        if fault:
            self.fail(fault)
            return
        self.checker.reconcile(block.header)
        if self._publisher is None or not self._publisher.ended:
            raise StreamFault(
                f"the plant ended after {self._samples} samples, before the end of the run"
            )
        if self._answering is not None:
            self._answering.reconcile()

    def fail(self, sentence: str) -> None:
        """Announce the fault that ends this role, unless it has ended."""
        if self._offered is not None:
            shared_memory.leave(self._offered)
        if self._publisher is not None and not self._publisher.ended:
            found = self._answering
            if found and found.in_ring and found.samples > self._samples:
                with suppress(StreamFault, BusError):
                    self._publish(found.reply())
            self._publisher.end(fault=sentence, report=self._report)
