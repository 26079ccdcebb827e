"""A law's file may hold a loop without end: what it does before a run is given up in time."""

import ctypes
import threading
from collections.abc import Iterator
from contextlib import contextmanager

PATIENCE_S = 20.0


class Overdue(BaseException):
    """Raised in whatever is overdue; no Exception, which a law might catch."""


@contextmanager
def given_up_in_time(patience_s: float | None = None) -> Iterator[None]:
    """Raise Overdue out of the Python code inside when it takes longer than `patience_s`."""
    thread, over, lock = ctypes.c_ulong(threading.get_ident()), False, threading.Lock()
    interrupt = ctypes.pythonapi.PyThreadState_SetAsyncExc

    def give_up() -> None:
        # Never to be taken back: CPython 3.11 would count one as under way for ever, and go round
        # in circles for whoever traces it (a debugger, a measurement of coverage).
        with lock:
            if not over:
                interrupt(thread, ctypes.py_object(Overdue))

    timer = threading.Timer(patience_s or PATIENCE_S, give_up)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        with lock:  # one that comes late is raised here
            over = True
