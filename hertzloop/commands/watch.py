"""The command that shows a run while it goes on."""

import contextlib
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hertzloop.commands.options import (
    ConnectOption,
    MachineOption,
    NameOption,
    OverwriteOption,
    check_output,
)
from hertzloop.commands.process_frame import check_endpoints
from hertzloop.commands.terminal import err, fail, out
from hertzloop.processes.signals import INTERRUPTED, on_interrupt, raise_when_ended

if TYPE_CHECKING:
    import rerun as rr


def watch(
    name: NameOption = "hertzloop",
    connect: ConnectOption = None,
    save: Annotated[
        Path | None, typer.Option(help="Write an .rrd file instead.", metavar="F.rrd")
    ] = None,
    overwrite: OverwriteOption = False,
    machine: MachineOption = False,
) -> None:
    """Watch a run while it goes on: a few samples of every millisecond. It never slows the run;
    what this side does not take in time is dropped."""
    import rerun as rr
    import zenoh

    from bus.port import PeerLost
    from bus.wire import MessageError
    from hertzloop.processes.observer import truth_blocks
    from hertzloop.processes.roles import BASE_PORT
    from recordings.replay import viewer

    check_endpoints("--connect", connect)
    if save is not None:
        if save.suffix != ".rrd":
            fail(f"--save {save} does not end in .rrd, which is what it writes", 2)
        check_output(save, overwrite, "--save")
    elif not viewer.has_display():
        fail("there is no screen to watch on; --save F.rrd writes a file for the Rerun viewer", 2)
    where = connect or [f"tcp/127.0.0.1:{port}" for port in range(BASE_PORT, BASE_PORT + 3)]
    raise_when_ended()
    ended: list[str] = []
    stream, shown, why, code = rr.RecordingStream("hertzloop live"), 0, "", 0
    try:
        with _shown_in(stream, save):
            stream.send_blueprint(viewer.live_blueprint())
            err.print(f"watching run '{name}'")
            try:
                with on_interrupt(ended.append):  # what was seen until now is kept
                    for payload in truth_blocks(name, where, machine):
                        with contextlib.suppress(MessageError):  # a stranger's
                            shown += viewer.send_block(stream, payload)
                if ended:
                    why, code = "interrupted", INTERRUPTED
            except PeerLost as error:
                why, code = str(error), 1
    except (zenoh.ZError, viewer.ViewerError, OSError) as error:
        fail(f"cannot watch: {error}", 1)
    out.print(f"watched: {shown:,} samples", soft_wrap=True)
    if why:
        kept = f"; what was seen until now is in {save}" if save else ""
        err.print(f"{why}{kept}", soft_wrap=True)
        raise typer.Exit(code)


@contextlib.contextmanager
def _shown_in(stream: "rr.RecordingStream", save: Path | None) -> Iterator[None]:
    """A file, or a viewer that stays open when the run has ended."""
    from bus.wire import reserved_ports
    from recordings.replay import viewer

    if save is not None:
        memory = stream.memory_recording()
        yield
        save.write_bytes(memory.drain_as_bytes())
        return
    with reserved_ports(1) as [port]:
        command = [str(viewer.executable()), "--bind", "127.0.0.1", "--port", str(port)]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True, **quiet)  # type: ignore[call-overload]
        stream.connect_grpc(f"rerun+http://127.0.0.1:{port}/proxy")
        yield
        stream.flush()
