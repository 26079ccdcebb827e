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
from hertzloop.cli import outputs
from hertzloop.cli.node import check_endpoints
from hertzloop.cli.options import OverwriteOption, options_of, run_options
from hertzloop.cli.terminal import err, fail, out
from hertzloop.common.atomic_files import atomic_write
from hertzloop.loop.run_options import RunOptions
from hertzloop.processes.observer import truth_blocks
from hertzloop.processes.program import BASE_PORT, BUS_NAME
from hertzloop.processes.roles import BusAddress
from hertzloop.processes.signals import INTERRUPTED, deferred

if TYPE_CHECKING:
    import rerun as rr


@run_options("name", name=BUS_NAME)
@options_of(BusAddress, "connect", argument="asked")
def watch(
    machine: Annotated[bool, typer.Option("--machine", hidden=True)] = False,  # of `run --live`
    save: Annotated[
        Path | None, typer.Option(metavar="F.rrd", help="Write an .rrd file instead.")
    ] = None,
    overwrite: OverwriteOption = False,
    *,
    asked: BusAddress,
    options: RunOptions,
) -> None:
    """Show a run in progress without delaying it.

    It shows a few samples of every millisecond, and drops what it cannot take in time.
    """
    import rerun as rr  # 0.5 s, as the next line

    from hertzloop.recordings.replay import live, viewer

    bus_name = options.name or BUS_NAME
    check_endpoints("--connect", asked.connect)
    if save is not None:
        if save.suffix != ".rrd":
            fail(f"--save = {save}: must end in .rrd. Change the name.")
        outputs.check_output(save, overwrite, "--save")
    elif not viewer.has_display():
        fail("no screen is available. Write a file for the Rerun viewer with --save F.rrd.")
    endpoints = list(asked.connect) or [
        f"tcp/127.0.0.1:{port}" for port in range(BASE_PORT, BASE_PORT + 3)
    ]
    stream = rr.RecordingStream("hertzloop live")
    samples, ended_by, code = 0, "", 0
    try:
        with _viewed(stream, save):
            stream.send_blueprint(live.live_blueprint())
            err.print(f"waiting for run '{bus_name}'")
            try:
                for payload in truth_blocks(bus_name, endpoints, machine):
                    is_first = samples == 0
                    with contextlib.suppress(MessageError):  # of another subscriber
                        samples += live.send_block(stream, payload)
                        if is_first and samples:
                            with deferred():  # else the line could come twice
                                err.print(f"watching run '{bus_name}'")
            except KeyboardInterrupt:  # what was seen until now is kept
                ended_by, code = "interrupted", INTERRUPTED
            except PeerLost as error:
                ended_by, code = str(error), 1
    except (zenoh.ZError, viewer.ViewerError, OSError) as error:
        fail(f"cannot watch: {error}", 1)
    out.say(f"watched: {samples:,} samples")
    if ended_by:
        kept = f"; what was seen until now is in {save}" if save else ""
        err.say(f"{ended_by}{kept}")
        raise typer.Exit(code)


@contextlib.contextmanager
def _viewed(stream: "rr.RecordingStream", save: Path | None) -> Iterator[None]:
    """Write a stream to a file, or show it in a viewer that stays open when the run has ended."""
    from hertzloop.recordings.replay import viewer  # 0.5 s

    if save is not None:
        memory = stream.memory_recording()
        yield
        atomic_write(save, memory.drain_as_bytes())
        return
    with reserved_ports(1) as [port]:
        command = [str(viewer.executable()), "--bind", "127.0.0.1", "--port", str(port)]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True, **quiet)  # type: ignore[call-overload]
        stream.connect_grpc(f"rerun+http://127.0.0.1:{port}/proxy")
        yield
        stream.flush()
