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
_LAST = 65535
_KIND = "unixsock-stream/"
_PREFIX = "hertzloop-bus-"
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
def own_endpoints() -> Iterator[list[str]]:
    """One for each role until the context ends: Unix sockets in a folder that only this user can
    enter.

    Where no folder for temporary files has a path that is short and plain enough: loopback.
    """
    with ExitStack() as stack:
        if folder := _short_folder(stack):
            yield [f"{_KIND}{folder}/{number}" for number in range(len(ROLES))]
        else:
            yield on_loopback(stack.enter_context(reserved_ports(len(ROLES))))


def _short_folder(stack: ExitStack) -> str | None:
    runtime = os.environ.get("XDG_RUNTIME_DIR") or "/tmp"
    for parent in (tempfile.gettempdir(), runtime, "/tmp"):
        named = f"{parent}/{_PREFIX}{'x' * 8}/00.lock"  # zenoh locks a file beside the socket
        if _PLAIN.fullmatch(named) and not too_long(_KIND + named):
            with suppress(OSError):
                return stack.enter_context(own_folder(_PREFIX, parent))
    return None


def remove_folder_of(endpoints: Sequence[str]) -> None:
    """Remove what a role listened on, and the folder if nothing else is left in it: for who
    outlives the folder's maker."""
    for endpoint in endpoints:
        path = Path(endpoint.removeprefix(_KIND))
        if endpoint.startswith(_KIND) and path.parent.name.startswith(_PREFIX):
            with suppress(OSError):
                for own in (path, path.with_name(f"{path.name}.lock")):
                    own.unlink(missing_ok=True)
                path.parent.rmdir()


RUN = "hertzloop-run-"
_YOUNG_S = 60.0  # in which whoever made a folder has surely locked it


@contextmanager
def own_folder(prefix: str = RUN, parent: str | None = None) -> Iterator[str]:
    """A folder with mode 700 that is removed at the end of the context.

    It is locked until then. A process that is killed leaves its folder without a lock, and the next
    call with the same prefix removes it. Raises OSError.
    """
    parent = parent or tempfile.gettempdir()
    _sweep(prefix, parent)
    folder = tempfile.mkdtemp(prefix=prefix, dir=parent)
    try:
        handle = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(handle, fcntl.LOCK_SH)
            yield folder
        finally:
            os.close(handle)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _sweep(prefix: str, parent: str) -> None:
    """Remove what this user's processes left here that had no time to do so."""
    for folder in Path(parent).glob(f"{prefix}*"):
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
def reserved_ports(count: int, in_a_row: bool = False) -> Iterator[list[int]]:
    """TCP ports on loopback that nobody is given by the kernel until the context ends.

    A port that is merely free at this moment can be the near end of anybody's connection by
    the time that it is to be listened on. Here a socket that does not listen is bound to each:
    the kernel passes such ports over, and lets whoever asks for one by its number, with
    SO_REUSEADDR as zenoh does, listen on it.
    """
    while True:
        with ExitStack() as held:
            try:
                first = _hold(held, 0)
                wanted = range(first + 1, first + count) if in_a_row else [0] * (count - 1)
                if in_a_row and wanted and wanted[-1] > _LAST:
                    continue
                ports = [first, *(_hold(held, number) for number in wanted)]
            except OSError:
                if not in_a_row:  # else one in the row is taken: from another start
                    raise
                continue
            yield ports
            return


def _hold(held: ExitStack, number: int) -> int:
    """Bind a port, 0 for any; its number. Raises OSError."""
    holder = held.enter_context(socket.socket())
    holder.bind((LOOPBACK, number))
    holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # from now on, not before
    return int(holder.getsockname()[1])
