"""Endpoints where the processes of a run meet; on one host, such as no other user can reach."""

import fcntl
import os
import re
import shutil
import socket
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from hertzloop.bus.streams import ROLES

LOOPBACK = "127.0.0.1"
_KIND = "unixsock-stream/"
_PREFIX = "hertzloop-run-"
_YOUNG_S = 60.0  # in which whoever made a folder has surely locked it
_LONGEST = 107  # bytes of a path that Linux binds a socket to
_PLAIN = re.compile(r"[A-Za-z0-9/_.+-]+")  # other characters may mean something to zenoh


def on_loopback(ports: Sequence[int]) -> list[str]:
    """Endpoints of ports of this machine."""
    return [f"tcp/{LOOPBACK}:{port}" for port in ports]


def mesh_endpoints(role: str, endpoints: Sequence[str]) -> tuple[list[str], list[str]]:
    """What a role listens on, and connects to: its own of all roles', and those before it."""
    place = ROLES.index(role)
    return [endpoints[place]], list(endpoints[:place])


def too_long(endpoint: str) -> bool:
    """Whether an endpoint is a Unix socket whose path the kernel does not take."""
    path = endpoint.removeprefix(_KIND)
    return path != endpoint and len(os.fsencode(path)) > _LONGEST


@contextmanager
def run_folder() -> Iterator[tuple[Path, list[str]]]:
    """Yield a folder for the files of a run, and an endpoint for each role: Unix sockets in it.

    Only this user can enter the folder, which is removed at the end of the context. Where no folder
    for temporary files has a path that is short and plain enough: ports on loopback.
    """
    with ExitStack() as stack:
        if folder := _short_folder(stack):
            yield folder, [f"{_KIND}{folder}/{number}" for number in range(len(ROLES))]
        else:
            ports = stack.enter_context(reserved_ports(len(ROLES)))
            yield Path(stack.enter_context(own_folder())), on_loopback(ports)


def _short_folder(stack: ExitStack) -> Path | None:
    runtime = os.environ.get("XDG_RUNTIME_DIR") or "/tmp"
    for parent in (tempfile.gettempdir(), runtime, "/tmp"):
        named = f"{parent}/{_PREFIX}{'x' * 8}/00.lock"  # zenoh locks a file beside the socket
        if _PLAIN.fullmatch(named) and not too_long(_KIND + named):
            with suppress(OSError):
                return Path(stack.enter_context(own_folder(parent)))
    return None


@contextmanager
def own_folder(parent: str | None = None) -> Iterator[str]:
    """A folder with mode 700 that is removed at the end of the context.

    It is locked until then. A process that is killed leaves its folder without a lock, and the next
    call removes it. Raises OSError.
    """
    parent = parent or tempfile.gettempdir()
    _sweep(parent)
    folder = tempfile.mkdtemp(prefix=_PREFIX, dir=parent)
    try:
        handle = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(handle, fcntl.LOCK_SH)
            yield folder
        finally:
            os.close(handle)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _sweep(parent: str) -> None:
    """Remove what this user's processes left here that had no time to do so."""
    for folder in Path(parent).glob(f"{_PREFIX}*"):
        with suppress(OSError):
            stat = folder.lstat()
            if stat.st_uid != os.getuid() or time.time() - stat.st_mtime < _YOUNG_S:
                continue
            handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder)
            finally:
                os.close(handle)


@contextmanager
def reserved_ports(count: int) -> Iterator[list[int]]:
    """TCP ports on loopback that nobody is given by the kernel until the context ends.

    A port that is merely free at this moment can be the near end of anybody's connection by
    the time that it is to be listened on. Here a socket that does not listen is bound to each:
    the kernel passes such ports over, and lets whoever asks for one by its number, with
    SO_REUSEADDR as zenoh does, listen on it.
    """
    with ExitStack() as held:
        yield [hold_port(held) for _ in range(count)]


def hold_port(held: ExitStack, number: int = 0) -> int:
    """Bind a port, 0 for any; its number. Raises OSError."""
    holder = held.enter_context(socket.socket())
    holder.bind((LOOPBACK, number))
    holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # from now on, not before
    return int(holder.getsockname()[1])
