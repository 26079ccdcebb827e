"""Ctrl-C, SIGTERM and a closed terminal end a command as KeyboardInterrupt."""

import ctypes
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130  # exit code
_PR_SET_PDEATHSIG = 1  # of prctl(2)
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
received = threading.Event()  # set by the first signal that raises KeyboardInterrupt


class Interrupted(KeyboardInterrupt):
    """A signal has ended the work of a process in order. The message, if any, says which."""


def _heeded() -> list[signal.Signals]:
    """The ending signals, without those that the caller ignores, as nohup ignores SIGHUP."""
    return [number for number in _ENDING if signal.getsignal(number) != signal.SIG_IGN]


def _interrupt(number: int, frame: FrameType | None) -> None:
    received.set()
    raise KeyboardInterrupt


def install_handlers() -> None:
    """Let SIGTERM and SIGHUP raise KeyboardInterrupt, as Ctrl-C does."""
    for number in _heeded():
        signal.signal(number, _interrupt)


def end_with_parent() -> None:
    """Let the kernel send SIGTERM to this process when the one that started it ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


@contextmanager
def deferred() -> Iterator[None]:
    """Hold the ending signals back until the end of the context.

    A process that is started inside begins with them blocked. The mask alone is not enough: the
    system then gives a signal to another thread, and Python handles it in the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # Python handles signals in the main thread only
        return
    came: list[int] = []
    handlers = {n: signal.signal(n, lambda number, _: came.append(number)) for n in _heeded()}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, handlers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


@contextmanager
def ending_signals(react: Callable[[int], None]) -> Iterator[None]:
    """Call react(1), react(2), ... for the ending signals that come, instead of raising.

    `react` runs in a thread of its own, so that it works while the main thread is inside a call
    that does not return. Outside the main thread, where Python handles no signals, nothing is done.
    Raises KeyboardInterrupt if one was raised before and lost, as in a call from C.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if received.is_set():
        raise KeyboardInterrupt
    reader, writer = socket.socketpair()
    writer.setblocking(False)

    def listen() -> None:
        count = 0
        while reader.recv(1):
            count += 1
            react(count)

    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    # The descriptor first: a signal in between is only delayed by its old handler.
    woken = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    before = {number: signal.signal(number, lambda *_: None) for number in _heeded()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(woken)
        writer.close()
        thread.join()
        reader.close()
