"""Ports that nobody else gets while the tests run."""

from contextlib import ExitStack

from hertzloop.bus.sockets import reserved_ports

_held = ExitStack()  # until this process ends


def free_ports(count: int, in_a_row: bool = False) -> list[int]:
    """TCP ports on loopback, held until the tests are over."""
    return _held.enter_context(reserved_ports(count, in_a_row))
