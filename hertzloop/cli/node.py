"""The commands `hertzloop node ...`: plant, controller, recorder, watch, keys."""

import contextlib
import ipaddress
import json
import os
import re
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
import zenoh

from hertzloop.bus.codec import MessageError
from hertzloop.bus.port import BusError, EndedByOther, PeerLost
from hertzloop.bus.process_clock import clock
from hertzloop.bus.sockets import reserved_ports, too_long
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES, StreamFault
from hertzloop.bus.zenoh_config import endpoints_named, names_endpoints
from hertzloop.cli import options
from hertzloop.cli.recordings import repeat_or_fail
from hertzloop.cli.terminal import err, fail, out
from hertzloop.extras import need
from hertzloop.loop.run_options import BusOptions, RunOptions
from hertzloop.processes import roles
from hertzloop.processes.observer import truth_blocks
from hertzloop.processes.program import BASE_PORT, BUS_NAME
from hertzloop.processes.roles import BusAddress, default_endpoints
from hertzloop.processes.signals import INTERRUPTED
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.scenes.loading import DEFAULT
from hertzloop.whole_files import write_together, write_whole

if TYPE_CHECKING:
    import rerun as rr


# Of the kinds that zenoh comes with here.
_ENDPOINT = re.compile(
    r"unixsock-stream/\S+|(?:tcp|tls|quic|udp|ws)/[^\s?#]+:[0-9]{1,9}(?:[?#]\S+)?"
)
_PORT = re.compile(r"(?:tcp|tls|quic|udp|ws)/[^\s?#]+:(?P<port>[0-9]+)(?:[?#]|$)")


@contextmanager
def framed(role: str, machine: bool) -> Iterator[Callable[..., None]]:
    """Frame of a process of a run: yields a function that reports to a launcher (`machine`).

    Faults are reported too, or told to a person; then the command ends with exit code 1, or
    130 if it was interrupted. A report says whether the fault is another role's (`others`),
    which roles were missing (`lost`), and when that was found (`at_s`). While the process runs, it
    says so again and again (`beat`).
    """

    def tell(**what: object) -> None:
        if machine:
            with suppress(BrokenPipeError):  # the launcher is gone, and cannot be told
                print(json.dumps(what) + "\n", end="", flush=True)  # at once: threads do

    if machine:
        roles.end_with_the_launcher()
        clock.on_beat = lambda: tell(beat=True)
    try:
        yield tell
    except KeyboardInterrupt as error:
        sentence = str(error) or f"{role} was interrupted"
        tell(fault=sentence)
        if not machine:
            err.print(sentence)
        raise typer.Exit(INTERRUPTED) from None
    except (BusError, StreamFault, RecordingError) as error:
        missed: dict[str, object] = {}
        if isinstance(error, PeerLost):
            missed = {"lost": list(error.roles), "at_s": error.at_s}
        others = isinstance(error, PeerLost | EndedByOther)
        tell(fault=str(error), others=others, **missed)
        if not machine:
            fail(str(error), 1)
        raise typer.Exit(1) from None
    finally:
        clock.on_beat = lambda: None


def bus_address(role: str, request: RunOptions, bus: BusOptions) -> BusAddress:
    """Address from the options of a command, else from its configuration, else on loopback.

    Ends the command if an endpoint or the configuration is none.
    """
    check_endpoints("--listen", bus.listen)
    check_endpoints("--connect", bus.connect)
    config = bus.zenoh_config
    own, others = default_endpoints(role, [BASE_PORT, BASE_PORT + 1, BASE_PORT + 2])
    try:
        if config:
            own = [] if names_endpoints(config, "listen") else own
            others = [] if names_endpoints(config, "connect") else others
            for endpoint in endpoints_named(config):
                _check_port(f"--zenoh-config: {config}: '{endpoint}'", endpoint)
    except BusError as error:
        fail(f"--zenoh-config: {error}")
    return BusAddress(
        request.name or BUS_NAME, bus.listen or own, bus.connect or others, config,
        request.timeout_s, bus.wait_s, bus.machine,
    )  # fmt: skip


@contextmanager
def playing(
    role: str, request: RunOptions, bus: BusOptions
) -> Iterator[tuple[Callable[..., None], BusAddress]]:
    """Frame of a role that meets the others: see `framed`; and where it does."""
    with framed(role, bus.machine) as tell:
        address = bus_address(role, request, bus)
        if not bus.machine:
            others = " and ".join(other for other in ROLES if other != role)
            err.print(f"{role} on {where(address)}: waiting for {others}")
        yield tell, address


def check_endpoints(option: str, endpoints: Sequence[str]) -> None:
    """End the command if what an option gives is no endpoint."""
    for endpoint in endpoints:
        found = _ENDPOINT.fullmatch(endpoint)
        if not found:
            example = f"tcp/127.0.0.1:{BASE_PORT}"
            fail(f"{option} = '{endpoint}': invalid endpoint. Write it as {example}.")
        _check_port(f"{option} '{endpoint}'", endpoint)
        if too_long(endpoint):
            fail(f"{option} = '{endpoint}': the path is too long. Use at most 107 bytes.")


def _check_port(named: str, endpoint: str) -> None:
    """End the command if an endpoint's port, if it has one, cannot be."""
    found = _PORT.search(endpoint)
    if found and int(found["port"]) > options.LARGEST_PORT:
        fail(f"{named} has no port up to {options.LARGEST_PORT}")


def where(address: BusAddress) -> str:
    """Where a role listens, in words."""
    return ", ".join(address.listen) or f"the endpoints of {address.config_file}"


def progress_reporter(tell: Callable[..., None]) -> Callable[[int], None]:
    """Report progress at most ten times a second."""
    last = [0.0]

    def report(step: int) -> None:
        now = time.monotonic()
        if now - last[0] > 0.1:
            last[0] = now
            tell(step=step)

    return report


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


def say_profile(stats: dict[str, Any]) -> None:
    """One line on what was granted."""
    err.say(f"real-time profile: {stats['realtime']}")


@options.takes(PLANT, name=BUS_NAME, realtime="auto")
def plant(
    request: RunOptions,
    bus: BusOptions,
    scene: options.SceneArgument = DEFAULT,
    settings: options.SetOption = None,
    seed: options.SeedOption = None,
) -> None:
    """Run the plant as a separate process.

    It waits for controller and recorder, then runs the scene.
    """
    resolved = options.scene_from(scene, settings, seed, tried=bus.machine)
    options.check_pace(resolved, request)
    repeat = request.repeat
    repeated = repeat_or_fail(read(repeat), resolved) if repeat else None
    with playing(PLANT, request, bus) as (tell, address):
        stats = roles.run_plant(
            resolved, replace(address, on_open=lambda: tell(open=True)), request,
            lambda: tell(ready=True), progress_reporter(tell), repeated,
        )  # fmt: skip
        tell(done=stats)
        if not bus.machine:
            say_profile(stats)
            out.print(f"{resolved.steps:,} steps in {stats['wall_s']:z.3f} s")


@options.takes(CONTROLLER, name=BUS_NAME, realtime="auto")
def controller(
    request: RunOptions,
    bus: BusOptions,
    law: str | None = None,
) -> None:
    """Run the controller as a separate process.

    It takes the scene from the plant, then answers the plant's samples.

    Args:
        law: Load the law from this file; default: controller.law of the scene.
    """
    with playing(CONTROLLER, request, bus) as (tell, address):
        stats = roles.run_controller(address, request, lambda: tell(ready=True), law)
        tell(done=stats)
        if not bus.machine:
            say_profile(stats)


@options.takes(RECORDER, name=BUS_NAME, realtime="auto")
def recorder(
    request: RunOptions,
    bus: BusOptions,
    out_file: Annotated[Path, typer.Option("--out", "-o")] = Path("run.mcap"),
) -> None:
    """Run the recorder as a separate process.

    It writes every stream of a run into one MCAP file.

    Args:
        out_file: Recording to write.
    """
    options.check_recording(out_file, request.overwrite)
    with playing(RECORDER, request, bus) as (tell, address):
        stats = roles.run_recorder(out_file, address, request, lambda: tell(ready=True))
        tell(done=stats)
        if not bus.machine:
            out.print(f"recorded {out_file}")


def keys(
    folder: Annotated[Path, typer.Argument(metavar="DIR")],
    hosts: Annotated[str, typer.Option(metavar="plant=A,controller=B,recorder=C")],
    days: Annotated[int, typer.Option(min=1, max=36500)] = 365,
) -> None:
    """Write certificates for a run on several hosts.

    The folder gets a configuration for each role, with certificates that keep everybody else off
    the bus.

    Args:
        folder: New folder for the certificates.
        hosts: Assign a host to each role, with or without a port.
        days: Limit the validity of the certificates to this time, days.
    """
    places = _places(hosts)
    need("cryptography")
    from hertzloop.certificates import Authority, configurations

    if os.path.isdir(folder) and any(folder.iterdir()):
        fail(
            f"DIR = {folder}: the folder is not empty, and keys are never replaced. "
            "Choose another folder."
        )
    options.make_folder(folder)
    authority = Authority(days)
    texts = {
        f"{role}.json5": json.dumps(configuration, indent=1)
        for role, configuration in configurations(authority, places).items()
    } | {"authority.pem": authority.pem(), "authority.key": authority.key_pem()}
    # Nobody else can read them, from the first byte on.
    write_together({folder / name: f"{text}\n" for name, text in texts.items()}, mode=0o600)
    words = {PLANT: "plant SCENE", CONTROLLER: "controller", RECORDER: "recorder --out F.mcap"}
    out.print(f"Valid for {days} days. Copy one file to each host, and start there:")
    for role, (host, _) in places.items():
        out.say(f"  {host}: hertzloop node {words[role]} --zenoh-config {role}.json5")
    out.say(
        f"Who has one of these files is that role; {folder / 'authority.key'} can make more: it "
        "stays here."
    )


_EXAMPLE = "plant=10.0.0.1,controller=10.0.0.2,recorder=10.0.0.3"
_NAME = re.compile(r"(?!-)[A-Za-z0-9-]{1,63}(\.(?!-)[A-Za-z0-9-]{1,63})*")


def _places(hosts: str) -> dict[str, tuple[str, int]]:
    """Host and port of every role, in the order of roles."""
    places: dict[str, tuple[str, int]] = {}
    for word in hosts.split(","):
        role, _, where = word.strip().partition("=")
        if role not in ROLES:
            fail(f"--hosts = '{word}': invalid entry. Write ROLE=HOST for each role: {_EXAMPLE}.")
        if role in places:
            fail(f"--hosts: the {role} is given twice. Remove one entry.")
        places[role] = _place(role, where, BASE_PORT + ROLES.index(role))
    if missing := [role for role in ROLES if role not in places]:
        fail(f"--hosts lacks the {' and the '.join(missing)}; write {_EXAMPLE}")
    ordered = {role: places[role] for role in ROLES}
    if len(set(ordered.values())) < len(ordered):
        fail("--hosts: two roles have the same host and port. Give each role its own port.")
    return ordered


def _bare(host: str) -> str:
    return host[1:-1] if host.startswith("[") and host.endswith("]") else host


def _place(role: str, where: str, port: int) -> tuple[str, int]:
    """Host and port in `where`: an address or a name, with a port or not."""
    try:
        return str(ipaddress.ip_address(_bare(where))), port
    except ValueError:
        host, colon, digits = where.rpartition(":")
    if colon:
        if not digits.isdecimal() or not 0 < int(digits) <= options.LARGEST_PORT:
            said = f"it is a number to {options.LARGEST_PORT}"
            fail(f"--hosts has the port '{digits}' for the {role}; {said}")
        where, port = _bare(host), int(digits)
    try:
        return str(ipaddress.ip_address(where)), port
    except ValueError:
        pass
    if not _NAME.fullmatch(where) or where.replace(".", "").isdecimal():
        fail(f"--hosts = '{where}': invalid host for the {role}. Give an address or a host name.")
    return where, port
