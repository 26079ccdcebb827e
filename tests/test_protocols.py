"""What we ship has the functions and arguments that `common/protocols.py` states."""

import inspect
from importlib import import_module

import pytest

from hertzloop.bus.port import InProcessPort
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.closed_loop import exchange
from hertzloop.common import protocols
from hertzloop.common.uncompiled import plain
from hertzloop.controller.loading.compiled import FUNCTIONS, arguments_of
from hertzloop.controller.loading.registry import shipped
from hertzloop.recordings import reader


def functions(protocol):
    """Functions of a protocol with the names of their arguments."""
    return {
        name: list(inspect.signature(function).parameters)
        for name, function in inspect.getmembers(protocol, inspect.isfunction)
        if not name.startswith("_")
    }


def arguments(function):
    return list(inspect.signature(plain(function)).parameters)


@pytest.mark.parametrize("port", [InProcessPort, ZenohPort])
def test_a_port(port):
    for name, expected in functions(protocols.Port).items():
        assert arguments(getattr(port, name)) == expected


def test_an_exchange():
    for name, expected in functions(protocols.ExchangeFunctions).items():
        assert arguments(getattr(exchange, name)) == expected


def test_a_reader():
    assert arguments(reader.read) == arguments(protocols.Reader.__call__)[1:]


def test_the_compiled_functions_of_a_law():
    stated = functions(protocols.LawFile)
    assert {name: arguments_of(name) for name in FUNCTIONS} == {
        name: ", ".join(stated[name]) for name in FUNCTIONS
    }


@pytest.mark.parametrize("law", shipped())
def test_the_functions_of_a_shipped_law(law):
    home = import_module(f"hertzloop.controller.laws.{law}")
    for name, stated in functions(protocols.LawFile).items():
        if name == "command" or hasattr(home, name):
            assert arguments(getattr(home, name))[: len(stated)] == stated, name
