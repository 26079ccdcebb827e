"""The three processes of a run over zenoh, each as one function: role, port, loop, end.

Every function reports how far it is, and returns statistics of its part, or raises BusError,
StreamFault, RecordingError or Interrupted with one sentence.
"""

import os
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from hertzloop.bus.port import BusError, EndedByOther, PeerLost
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES, StreamFault
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.common.sanitize import visible
from hertzloop.loop import stuck_law
from hertzloop.loop.repeated_run import repeated_run
from hertzloop.loop.run_options import Options, RunOptions, Use
from hertzloop.processes.child_process import Report
from hertzloop.processes.program import BUS_NAME
from hertzloop.processes.realtime import RealtimeProfile
from hertzloop.processes.signals import INTERRUPTED, Interrupted, ending_signals
from hertzloop.recordings.reader import read
from hertzloop.recordings.recorder import Recorder
from hertzloop.recordings.writer import RecordingError
from hertzloop.scene.setup import Setup

if TYPE_CHECKING:
    from hertzloop.loop.controller_node import ControllerNode

_HEAR_FAULT_S = 2.0  # for the others to hear of a fault
_COMPLETION_S = 60.0  # for the recorder to close its file, at least
# For an interrupted role to end in order, before the launcher kills it, and for the controller to
# leave.
_EXIT_S = 4.0
# In timeouts: how long the roles wait for a message. A message that is not accepted is given up
# after one; so a role that is kept from going on can say why before the others miss it.
_WAITS = {PLANT: 1.25, CONTROLLER: 1.5, RECORDER: 2.0}


class BusAddress(Options):
    """Where one process of a run meets the others, each connected with each."""

    listen: Annotated[Sequence[str], Field(description="Listen on this endpoint.")] = ()
    connect: Annotated[Sequence[str], Field(description="Connect to this endpoint.")] = ()
    zenoh_config: Annotated[
        Path | None, Field(description="Read the zenoh configuration from this JSON5 file.")
    ] = None
    wait_s: Annotated[
        float,
        Field(
            ge=0.1,
            le=1_000_000,
            description="Stop waiting for other processes to appear after this time, s.",
        ),
        Use(flag="--wait"),
    ] = 60.0


def _unheard(**_: object) -> None:
    """Report to nobody."""


def _say(sentence: str) -> None:
    """Write to standard error: a terminal of `node ROLE`; under `run` a file, of which the last
    line is told if the role fails."""
    sys.stderr.write(f"{visible(sentence)}\n")
    sys.stderr.flush()


@contextmanager
def _joined(
    address: BusAddress, role: str, options: RunOptions, report: Report
) -> Iterator[ZenohPort]:
    """Join the bus, and leave it after the recorder, so that nothing sent is lost.

    A signal makes the next wait raise Interrupted; a second one, or a role that does not get to
    its next wait because another hangs, ends the process at once.
    """
    opened_s = time.monotonic()
    where = (address.listen, address.connect, address.zenoh_config)
    port = ZenohPort(role, options.name or BUS_NAME, *where, options.timeout_s)
    report(open=role)

    def exit_now() -> None:
        _say(f"{role} was interrupted, and left before its part was complete")
        os._exit(INTERRUPTED)

    overdue = threading.Timer(_EXIT_S, exit_now)
    overdue.daemon = True

    def react(count: int) -> None:
        if count > 1:
            exit_now()
        # At the next wait: out of a handler it could fall between a message and its count.
        port.abort(Interrupted())
        overdue.start()

    with ending_signals(react):
        try:
            yield port
        except BaseException as error:
            # Who does not react will not hear either; the recorder may still write. It has no final
            # message: what it heard, the others shall hear before they miss it, and name the cause.
            if role != RECORDER or isinstance(error, StreamFault):
                lost = error.roles if isinstance(error, PeerLost) else ()
                port.liveliness.wait_until_heard(_HEAR_FAULT_S, {*lost} - {RECORDER})
            raise
        else:
            if role != RECORDER:
                # A recorder that fell behind may need as long again as the run took.
                port.liveliness.wait_for_completion(
                    RECORDER, max(_COMPLETION_S, time.monotonic() - opened_s)
                )
            if role == PLANT:  # its token could be gone before the controller hears its end
                port.liveliness.wait_until_gone(CONTROLLER, _EXIT_S)
        finally:
            port.close()
            overdue.cancel()


def run_plant(
    setup: Setup,
    address: BusAddress,
    options: RunOptions,
    report: Report = _unheard,
) -> dict[str, Any]:
    """The plant process: waits for the others, runs the scene, in lock-step, perhaps as a repeat of
    a recorded run, or at a pace; says how fast that went."""
    from hertzloop.loop.plant_node import PlantNode
    from hertzloop.loop.plant_streams import EVERY_S

    repeat = repeated_run(read(options.repeat)) if options.repeat else None
    profile = RealtimeProfile(options.realtime, PLANT)
    with _joined(address, PLANT, options, report) as port:
        node = PlantNode(
            setup,
            port,
            options.model_copy(update={"timeout_s": _WAITS[PLANT] * options.timeout_s}),
            lambda step: report(step=step),
            repeat,
            wait_s=address.wait_s,
            every_s=0.0 if options.pace else EVERY_S,
        )
        port.liveliness.announce()
        port.liveliness.wait_for([CONTROLLER, RECORDER], address.wait_s)
        report(ready=True)
        try:
            with profile.loop():
                stats = node.run()
        except KeyboardInterrupt as error:
            sentence = f"interrupted at step {node.streams.step}"
            node.streams.fail(sentence)
            raise Interrupted(f"plant was {sentence}") from error
    return vars(stats) | {"realtime": profile.line}


def run_controller(
    address: BusAddress,
    options: RunOptions,
    report: Report = _unheard,
    law: str | None = None,
) -> dict[str, Any]:
    """The controller process: answers samples until the plant announces its end, by the law that
    the scene names, or by the file `law`, if that is the same."""
    from hertzloop.loop.controller_node import ControllerNode

    profile = RealtimeProfile(options.realtime, CONTROLLER)
    with _joined(address, CONTROLLER, options, report) as port:
        node = ControllerNode(port, law=law, shared_memory=options.shared_memory)
        port.liveliness.announce()
        port.liveliness.wait_for([PLANT, RECORDER], address.wait_s)
        report(ready=True)
        try:
            with profile.loop():
                _answer_all(node, address.wait_s, _WAITS[CONTROLLER] * options.timeout_s)
        except (StreamFault, BusError, KeyboardInterrupt) as error:
            interrupted = isinstance(error, KeyboardInterrupt)
            sentence = "the controller was interrupted" if interrupted else str(error)
            with suppress(BusError):  # the first fault is the one to tell
                node.fail(sentence)
            if interrupted:
                raise Interrupted(sentence) from error
            raise
        if node.fault:
            raise EndedByOther(f"the plant ended the run: {node.fault}")
    return {"realtime": profile.line}


def _answer_all(node: "ControllerNode", wait_s: float, timeout_s: float) -> None:
    """Do the controller's part, to the end of the run. A law that never returns ends the process,
    after the plant has given it up."""
    while node.setup is None and not node.done:
        node.work(wait_s)
    if node.setup is None:
        return
    patience_s = timeout_s + stuck_law.PATIENCE_S
    with stuck_law.watching(node.setup, lambda: node.law_samples, patience_s=patience_s):
        while not node.done:
            node.work(timeout_s)


@contextmanager
def _recording(recorder: Recorder) -> Iterator[Recorder]:
    """A recorder whose file is closed in any case, and says why it is not complete."""
    try:
        yield recorder
    except BaseException as error:
        interrupted = isinstance(error, KeyboardInterrupt)
        sentence = "the recorder was interrupted" if interrupted else str(error) or repr(error)
        with suppress(RecordingError):  # the first fault is the one to tell
            recorder.close(sentence)
        if interrupted:
            raise Interrupted(sentence) from error
        raise
    recorder.close()


def run_recorder(
    path: Path,
    address: BusAddress,
    options: RunOptions,
    report: Report = _unheard,
) -> dict[str, Any]:
    """The recorder process: writes everything down until both roles have ended."""
    profile = RealtimeProfile(options.realtime, RECORDER)
    with _joined(address, RECORDER, options, report) as port:
        with _recording(Recorder(path, options.overwrite, options.note)) as recorder:
            port.liveliness.announce()
            port.liveliness.wait_for([PLANT, CONTROLLER], address.wait_s)
            report(ready=True)
            with profile.loop():
                # The run begins with the first forces: the controller may compile its law before.
                patience_s = address.wait_s
                while not recorder.done:
                    envelope = port.receive(patience_s, "messages from plant and controller", ROLES)
                    recorder.handle(envelope)
                    if envelope.stream in ("force", "end/controller", "end/plant"):
                        patience_s = _WAITS[RECORDER] * options.timeout_s
                    if envelope.stream.startswith("end/"):
                        port.liveliness.release(envelope.stream.removeprefix("end/"))
            recorder.reconcile()
        if recorder.faults:
            raise EndedByOther(recorder.faults[0])
        port.liveliness.confirm_completion()
    return {"realtime": profile.line}
