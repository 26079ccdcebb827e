"""The controller's side of the exchange: samples in, forces and promises out."""

import numpy as np

from bus.messages_pb2 import DaqBlock, ForceBlock
from bus.port import Port, Publisher
from bus.streams import Checker, Envelope, StreamFault
from bus.wire import Packed
from controller.controller import Controller, Law, LawSpec, LineSpec
from hertzloop import parts
from hertzloop.events import ControllerEvents
from hertzloop.scene import SceneError, parse


def sampled_values(block: Packed) -> np.ndarray:
    """Physical values of a DaqBlock, shape (samples,), in the unit of its quantity."""
    codes = block.arrays["code"]
    if len(codes):
        return np.asarray(block.header.offset + block.header.scale * codes)
    return np.array(block.arrays["value"], dtype=float)


class ControllerNode:
    """Answers every block of samples with a block of forces; set up by the plant's hello."""

    def __init__(self, port: Port, look_ahead: bool = True) -> None:
        self.port, self.look_ahead = port, look_ahead
        self.checker = Checker()
        self.done = False
        self._controller: Controller | None = None
        self._samples = 0
        # Loads the kernels before anybody waits for an answer.
        Controller(LawSpec(Law.OFF, 1.0), LineSpec(), 1e-6, 1, 1, 0).process(np.empty(0))

    def handle(self, envelope: Envelope) -> None:
        """Take one message. Raises StreamFault if it is not what had to come."""
        block = self.checker.accept(envelope)
        if envelope.stream == "hello":
            self._set_up(block)
        elif envelope.stream == "daq":
            self._answer(block)
        elif envelope.stream == "end/plant":
            self._end(block)

    def _set_up(self, block: Packed) -> None:
        try:
            scene = parse(block.header.scene_toml)
            self._controller = parts.controller(scene, block.header.stiffness)
        except SceneError as error:
            raise StreamFault(f"the plant announced a scene that cannot be: {error}") from error
        self._scene = scene
        self._publisher = Publisher(self.port, self.checker.run_id)
        self._events = ControllerEvents(scene)

    def _answer(self, block: Packed) -> None:
        if self._controller is None:
            raise StreamFault("samples came before the plant announced the run")
        header: DaqBlock = block.header
        values = sampled_values(block)
        if self._samples + len(values) > len(self._controller.law_state.history):
            raise StreamFault(f"stream 'daq' sequence {header.sequence} is beyond the run's end")
        if not np.all(np.isfinite(values)):
            raise StreamFault(f"stream 'daq' sequence {header.sequence} holds a value not finite")
        reply = self._controller.process(values, self.look_ahead)
        answer = ForceBlock(
            first_step=reply.first_step,
            step_ns=header.step_ns,
            samples_seen=reply.samples_seen,
            promise_zero=reply.promise_zero,
            promise_level=reply.promise_level,
        )
        self._publisher.send("force", answer, {"force_n": reply.forces})
        for event in self._events.of(self._samples, reply.modes, reply.delays):
            self._publisher.send("events/controller", event)
        self._samples += len(values)

    def _end(self, block: Packed) -> None:
        self.done = True
        fault = block.header.fault
        if not fault:
            self.checker.reconcile(
                type(block.header)(count=[c for c in block.header.count if c.stream == "daq"])
            )
        if self._controller is not None:
            self._publisher.end(fault=fault)

    def fail(self, sentence: str) -> None:
        """Tell the others why this role gives up."""
        if self._controller is not None:
            self._publisher.end(fault=sentence)
