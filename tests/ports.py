"""Ports that nobody else gets while the tests run."""

from contextlib import ExitStack

from hertzloop.bus.sockets import hold_port, reserved_ports

_held = ExitStack()  # until this process ends


def free_ports(count: int) -> list[int]:
    """TCP ports on loopback, held until the tests are over."""
    return _held.enter_context(reserved_ports(count))


def ports_in_a_row(count: int) -> list[int]:
    """The same, with numbers in a row."""
    while True:
        with ExitStack() as held:
            first = hold_port(held)
            try:
                found = [first, *(hold_port(held, first + n) for n in range(1, count))]
            except (OSError, OverflowError):  # one is taken, or there is none: from another start
                continue
            _held.enter_context(held.pop_all())
            return found
