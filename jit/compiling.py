"""Whether something is compiled: what its types decide, and notice of the moment."""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba import typeof
from numba.core import event


def types_digest(*values: Any) -> str:
    """16 hex digits that change with the types of values: kernels are compiled once for each."""
    text = "\0".join(str(typeof(value)) for value in values)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class _Notice(event.Listener):
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


@contextmanager
def noticed(tell: Callable[[bool], None]) -> Iterator[None]:
    """Call tell(True) when this process begins to compile a kernel, tell(False) when that kernel is
    done; not for a kernel that is loaded from the cache."""
    with event.install_listener("numba:compile", _Notice(tell)):
        yield
