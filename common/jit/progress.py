"""Tell what this process compiles, while it does."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event


@contextmanager
def report_functions(tell: Callable[[str], None]) -> Iterator[None]:
    """Call `tell` after every function of hertzloop that is compiled, with its name in words."""
    with event.install_listener("numba:compile", _Names(tell)):
        yield


class _Names(event.Listener):
    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell

    def on_start(self, event: Any) -> None:
        pass

    def on_end(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        if function.__module__.startswith("hertzloop.") and "<" not in function.__qualname__:
            self._tell(function.__name__.strip("_").replace("_", " "))
