"""The one policy for signals that end a process: Ctrl-C, Ctrl-\\, termination, a closed terminal.

| who | what a signal does |
|---|---|
| a command that still imports | ends it at once (`command_line`) |
| a command that works | raises KeyboardInterrupt, but not within LLVM's compiler (`interrupt`) |
| a sweep that asks its workers | is held back meanwhile (`interrupts_held_back`) |
| launcher and roles | is counted in a thread, and the run ends in order (`ending_signals`) |
| fork server | Ctrl-C is left to the launcher, which ends the roles (`left_to_the_launcher`) |

Whoever has something to say or to close when a signal ends its work does so by `on_interrupt`.
"""

import atexit
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

INTERRUPTED = 130  # exit code
_LLVM = os.path.join("", "llvmlite", "binding", "")
_SOON_S = 0.01
_on_their_way: set[int] = set()  # signals that will be sent again
_held: list[set[int]] = []  # a set for each reason to hold interrupts back, of what came meanwhile
_lost = threading.Event()  # a KeyboardInterrupt was
_unraisable_before = sys.unraisablehook
_code: list[int] = []  # to end with, whatever Python would make of it


class Interrupted(KeyboardInterrupt):
    """A signal has ended the work of a process in order; the sentence, if any, says which."""


@contextmanager
def on_interrupt(react: Callable[[str], object]) -> Iterator[None]:
    """Call `react` when a signal ends what is inside, with the sentence of `Interrupted` or "".

    The signal counts as heard then, unless `react` raises.
    """
    try:
        yield
    except KeyboardInterrupt as error:
        react(str(error))


@contextmanager
def interrupted_as(sentence: Callable[[], str]) -> Iterator[None]:
    """Raise `Interrupted` with this sentence when a signal ends what is inside."""
    try:
        yield
    except KeyboardInterrupt as error:
        raise Interrupted(sentence()) from error


def how_ended(code: int) -> str:
    """How a process ended, if its exit code says that a signal ended it; else ""."""
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return "was interrupted" if code == INTERRUPTED else ""


def kill_child(pid: int) -> int:
    """Kill a child process and wait for its end. Return the signal that had ended it before, or
    0."""
    os.kill(pid, signal.SIGKILL)
    _, status = os.waitpid(pid, 0)
    number = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    return 0 if number == signal.SIGKILL else number


def leave(number: int, frame: FrameType | None) -> None:
    """End at once: an exception in the middle of an import may come out as anything."""
    sys.stderr.write("interrupted\n")
    sys.stderr.flush()
    os._exit(INTERRUPTED)


def _end() -> None:
    """End with the exit code of an interrupt, or of a process that used zenoh. Python would end by
    SIGINT at last if an interrupt came through exec(), as imports use it, however it was handled.
    """
    if _code:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(_code[0])
    # Python restores the default handler, by which an interrupt would kill a command that is done.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def command_line() -> Iterator[Callable[[], None]]:
    """Frame of a command: yields what to call once everything is imported.

    Until then a signal ends the process at once; from then on it raises KeyboardInterrupt.
    """
    atexit.register(_end)  # before the imports: the first to be registered is the last to run
    before = signal.getsignal(signal.SIGINT)
    raise_when_ended(leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # a launcher holds it back

    def imported() -> None:
        raise_when_ended()
        if before == signal.SIG_IGN:
            signal.signal(signal.SIGINT, before)
        hear_lost_interrupts()

    try:
        yield imported
    except Exception:
        if _lost.is_set():  # and compiling, say, has failed for want of what it was to bring
            leave(signal.SIGINT, None)
        raise
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
        with suppress(OSError, ValueError):  # Python reports it when it flushes again
            sys.stdout.flush()
        # Another one, while Python ends, would come out as an exception.
        raise_when_ended(lambda *_: os._exit(code))
        # zenoh may still call Python from its threads, which aborts after the exit functions.
        if code == INTERRUPTED or "zenoh" in sys.modules:
            _code.append(code)
        raise


def _ending() -> list[signal.Signals]:
    """All of them; without SIGHUP or SIGQUIT where it is ignored, as under nohup or in a script."""
    more = [signal.SIGHUP, signal.SIGQUIT]
    heeded = [number for number in more if signal.getsignal(number) != signal.SIG_IGN]
    return [signal.SIGINT, signal.SIGTERM, *heeded]


def _send_soon(number: int) -> None:
    """Send the main thread a signal in a moment; once, however often it came until then."""
    if number in _on_their_way:
        return
    _on_their_way.add(number)
    main = threading.main_thread().ident
    assert main is not None  # it has started

    def send() -> None:
        _on_their_way.discard(number)
        signal.pthread_kill(main, number)

    timer = threading.Timer(_SOON_S, send)
    timer.daemon = True
    timer.start()


def _unraisable(unraisable: Any) -> None:
    """Python's hook for what nobody can catch."""
    if not isinstance(unraisable.exc_value, KeyboardInterrupt):
        _unraisable_before(unraisable)
        return
    _lost.set()
    _send_soon(signal.SIGINT)  # here it would be lost again


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt; at once, or soon where it would be lost: where Python's side of LLVM
    is at work, where a lost one is about to be sent again, and while a class names its attributes:
    what comes out of that is a RuntimeError (before Python 3.12).

    What LLVM has called drops an exception, so that Numba misses what was compiled; a signal that
    comes while LLVM works is heard just there. What was to be made of LLVM's stays half made, and
    complains when it is thrown away.
    """
    if _held:
        _held[-1].add(number)
        return
    inner = frame
    while inner is not None:
        code = inner.f_code
        if (
            code is _unraisable.__code__
            or code.co_name == "__set_name__"
            or _LLVM in code.co_filename
        ):
            _send_soon(number)
            return
        inner = inner.f_back
    raise KeyboardInterrupt


def raise_when_ended(react: Callable[[int, FrameType | None], None] = interrupt) -> None:
    """From now on an ending signal raises KeyboardInterrupt, as Ctrl-C does, or calls `react`."""
    for number in _ending():
        signal.signal(number, react)


def hear_lost_interrupts() -> threading.Event:
    """From now on, interrupt the main thread again where KeyboardInterrupt was lost: nothing can be
    raised out of a call from C, as compiling has some, or from the collector. The event is set
    then: what else goes wrong may come of it. SIGINT's handler is to be `interrupt`."""
    sys.unraisablehook = _unraisable
    return _lost


@contextmanager
def ending_signals(react: Callable[[int], None]) -> Iterator[None]:
    """Call react(1), react(2), ... for the signals that come, instead of raising.

    It runs in a thread of its own, so that it works while the main thread is inside a call
    that does not return. In another than the main thread Python hears no signals: nothing
    is done there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
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
    before = {number: signal.signal(number, lambda *_: None) for number in _ending()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(woken)
        writer.close()
        thread.join()
        reader.close()


@contextmanager
def interrupts_held_back() -> Iterator[None]:
    """Hold Ctrl-C back; a process started meanwhile hears it when it can say so, or never.

    The system gives it to another thread then, if there is one that lets it through, and Python
    calls its handler in the main thread all the same: `interrupt` keeps it until the end.
    """
    main = threading.current_thread() is threading.main_thread()
    came: set[int] = set()
    if main:
        _held.append(came)
    try:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    finally:
        if main:
            _held.pop()
            for number in came:
                signal.raise_signal(number)


@contextmanager
def deaf_to_the_terminal() -> Iterator[None]:
    """Let a process that is started inside ignore what a terminal sends to all processes, except
    Ctrl-C."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP, signal.SIGQUIT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def left_to_the_launcher() -> None:
    """Hold Ctrl-C back in a fork server, and in its forks until they can say that they heard it.

    The launcher hears it and ends the roles. Termination ends the server.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def as_in_a_fresh_process() -> None:
    """Give a fork the handler of Ctrl-C that Python starts with."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


launcher_gone = threading.Event()


def end_with_the_launcher() -> None:
    """End this process as a signal would when its standard input ends: its launcher is gone."""

    def wait() -> None:
        while os.read(0, 1):
            pass
        launcher_gone.set()
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, daemon=True).start()
