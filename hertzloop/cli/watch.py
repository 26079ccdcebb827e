"""The command `hertzloop node watch`: a run in progress in the viewer, or as an .rrd file."""

import contextlib
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
import zenoh

from hertzloop.bus.codec import MessageError
from hertzloop.bus.port import PeerLost
from hertzloop.bus.sockets import reserved_ports
from hertzloop.cli import options
from hertzloop.cli.node import check_endpoints
from hertzloop.cli.terminal import err, fail, out
from hertzloop.common.atomic_files import write_whole
from hertzloop.loop.run_options import BusOptions, RunOptions
from hertzloop.processes.observer import truth_blocks
from hertzloop.processes.program import BASE_PORT, BUS_NAME
from hertzloop.processes.signals import INTERRUPTED, deferred

if TYPE_CHECKING:
    import rerun as rr


@options.takes(only=("name", "connect", "machine"), name=BUS_NAME)
def watch(
    request: RunOptions,
    bus: BusOptions,
    save: Annotated[Path | None, typer.Option(metavar="F.rrd")] = None,
    overwrite: options.OverwriteOption = False,
) -> None:
    """Show a run in progress without delaying it.

    It shows a few samples of every millisecond, and drops what it cannot take in time.

    Args:
        save: Write an .rrd file instead.
    """
    import rerun as rr  # 0.5 s, as the next line

    from hertzloop.recordings.replay import viewer

    name, connect = request.name or BUS_NAME, bus.connect
    check_endpoints("--connect", connect)
    if save is not None:
        if save.suffix != ".rrd":
            fail(f"--save = {save}: must end in .rrd. Change the name.")
        options.check_output(save, overwrite, "--save")
    elif not viewer.has_display():
        fail("no screen is available. Write a file for the Rerun viewer with --save F.rrd.")
    where = connect or [f"tcp/127.0.0.1:{port}" for port in range(BASE_PORT, BASE_PORT + 3)]
    stream, shown, why, code = rr.RecordingStream("hertzloop live"), 0, "", 0
    try:
        with _shown_in(stream, save):
            stream.send_blueprint(viewer.live_blueprint())
            err.print(f"waiting for run '{name}'")
            try:
                for payload in truth_blocks(name, where, bus.machine):
                    first = not shown
                    with contextlib.suppress(MessageError):  # of another subscriber
                        shown += viewer.send_block(stream, payload)
                        if first and shown:
                            with deferred():  # else the line could come twice
                                err.print(f"watching run '{name}'")
            except KeyboardInterrupt:  # what was seen until now is kept
                why, code = "interrupted", INTERRUPTED
            except PeerLost as error:
                why, code = str(error), 1
    except (zenoh.ZError, viewer.ViewerError, OSError) as error:
        fail(f"cannot watch: {error}", 1)
    out.say(f"watched: {shown:,} samples")
    if why:
        kept = f"; what was seen until now is in {save}" if save else ""
        err.say(f"{why}{kept}")
        raise typer.Exit(code)


@contextlib.contextmanager
def _shown_in(stream: "rr.RecordingStream", save: Path | None) -> Iterator[None]:
    """A file, or a viewer that stays open when the run has ended."""
    from hertzloop.recordings.replay import viewer  # 0.5 s

    if save is not None:
        memory = stream.memory_recording()
        yield
        write_whole(save, memory.drain_as_bytes())
        return
    with reserved_ports(1) as [port]:
        command = [str(viewer.executable()), "--bind", "127.0.0.1", "--port", str(port)]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True, **quiet)  # type: ignore[call-overload]
        stream.connect_grpc(f"rerun+http://127.0.0.1:{port}/proxy")
        yield
        stream.flush()
