"""Reserved ports: who knows them listens on them, and nobody else is given them."""

import socket

import pytest

from hertzloop.bus.sockets import LOOPBACK, reserved_ports


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
