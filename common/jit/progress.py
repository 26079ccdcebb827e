"""Tell what this process compiles, while it does."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event


@contextmanager
def report_compiling(tell: Callable[[bool], None]) -> Iterator[None]:
    """Call tell(True) when this process begins to compile a kernel, and tell(False) when that
    kernel is done; not for a kernel that is loaded from the disk."""
    with event.install_listener("numba:compile", _Outermost(tell)):
        yield


@contextmanager
def report_functions(tell: Callable[[str], None]) -> Iterator[None]:
    """Call `tell` after every function that this process has compiled, with its name in words;
    that of a part of Numba is empty."""
    with event.install_listener("numba:compile", _Names(tell)):
        yield


class _Outermost(event.Listener):
    def __init__(self, tell: Callable[[bool], None]) -> None:
        self._tell, self._depth = tell, 0

    def on_start(self, event: Any) -> None:
        self._depth += 1
        if self._depth == 1:
            self._tell(True)

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._tell(False)


class _Names(event.Listener):
    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell

    def on_start(self, event: Any) -> None:
        pass

    def on_end(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        ours = function.__module__.startswith("hertzloop.") and "<" not in function.__qualname__
        self._tell(function.__name__.strip("_").replace("_", " ") if ours else "")
