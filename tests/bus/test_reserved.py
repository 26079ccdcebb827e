"""Reserved ports: the kernel gives them to nobody, who knows them listens on them."""

import socket
import struct
from collections.abc import Callable

import pytest

from hertzloop.bus.sockets import LOOPBACK, reserved_ports

IP_LOCAL_PORT_RANGE = 51  # Linux 6.3; Python's socket does not name it yet


def asks_for_any(number: int) -> socket.socket:
    """A socket whose "any port" is a given one: as if all others were in use."""
    asking = socket.socket()
    only = struct.pack("I", number << 16 | number)
    try:
        asking.setsockopt(socket.IPPROTO_IP, IP_LOCAL_PORT_RANGE, only)
    except OSError:
        asking.close()
        pytest.skip("this kernel cannot narrow a socket's range of ports")
    return asking


def listens(asking: socket.socket) -> None:
    asking.bind((LOOPBACK, 0))


def connects(asking: socket.socket) -> None:
    with socket.create_server((LOOPBACK, 0)) as server:
        asking.connect(server.getsockname())


@pytest.mark.parametrize("take", [listens, connects])
def test_nobody_is_given_them(take: Callable[[socket.socket], None]) -> None:
    with reserved_ports(2) as ports:
        for number in ports:
            with asks_for_any(number) as asking, pytest.raises(OSError, match=r"Cannot|in use"):
                take(asking)
    for number in ports:  # now they are free, and taken
        with asks_for_any(number) as asking:
            take(asking)
            assert asking.getsockname()[1] == number


def test_who_knows_them_listens_on_them_again_and_again() -> None:
    with reserved_ports(3, in_a_row=True) as ports:
        assert ports == [ports[0], ports[0] + 1, ports[0] + 2]
        for number in [*ports, *ports]:
            with (
                socket.create_server((LOOPBACK, number)) as server,
                socket.create_connection((LOOPBACK, number)),
            ):
                server.accept()[0].close()


def test_a_row_is_held_once() -> None:
    with reserved_ports(2, in_a_row=True) as one, reserved_ports(2, in_a_row=True) as other:
        assert not set(one) & set(other)
        for number in one:
            with socket.socket() as asking, pytest.raises(OSError, match="in use"):
                asking.bind((LOOPBACK, number))
