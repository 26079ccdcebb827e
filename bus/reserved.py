"""Ports on loopback, kept for processes that are still to come."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

LOOPBACK = "127.0.0.1"
_LAST = 65535


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
