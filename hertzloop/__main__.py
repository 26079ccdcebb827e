"""python -m hertzloop, and the command `hertzloop`: what it needs of the system it starts in.

Streams that are closed are opened on nothing, so that no file of the command takes their numbers.
What else the system lacks ends the command in one sentence.
"""

# `signal` wraps it in enumerations, which take longer to import than all before this line.
import _signal  # type: ignore[import-not-found]
import os
import sys

if __name__ == "__main__" or os.path.basename(sys.argv[0]) == "hertzloop":
    # Before the imports below, in which Python would report Ctrl-C line by line, and the others
    # would kill. Other programs import this module, too, and keep their handlers; what is ignored,
    # as SIGHUP under nohup, stays so.
    for _number in (_signal.SIGINT, _signal.SIGTERM, _signal.SIGHUP, _signal.SIGQUIT):
        if _signal.getsignal(_number) in (_signal.default_int_handler, _signal.SIG_DFL):
            _signal.signal(_number, lambda *_: (os.write(2, b"interrupted\n"), os._exit(130)))

import errno
import gc
import io
import resource
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from hertzloop.foreign import visible
from hertzloop.processes.signals import command_line

_STREAMS = ("stdin", "stdout", "stderr")
_FEW, _ENOUGH = 32, 1024  # open files: with fewer, the replay ends by a signal
_RAISE = f"Raise the limit of open files: ulimit -n {_ENOUGH}."
_REMEDIES = {
    errno.EMFILE: _RAISE,
    errno.ENFILE: "Close other programs.",
    errno.ENOSPC: "Free some space.",
}


class _Standard(io.FileIO):
    """Standard output or error, which may lead to a full disk.

    Results that cannot be written end the command. A message that cannot be written is lost, and
    the work goes on.
    """

    def write(self, data: Any) -> Any:
        """Write bytes, or end the command. Raises BrokenPipeError: nobody reads any more."""
        try:
            return super().write(data)
        except BrokenPipeError:
            raise
        except OSError as error:
            _open_on_nothing(self.fileno())  # what is left to be written would fail again
            if self.fileno() == 2:
                return len(data)
            _say(f"cannot write standard output: {error.strerror}")
            raise SystemExit(1) from None


def take_streams() -> None:
    """Let the standard streams of Python be those of the process, with none of them closed."""
    for number, name in enumerate(_STREAMS):
        try:
            os.fstat(number)
        except OSError:
            _open_on_nothing(number)
        found = getattr(sys, f"__{name}__")
        how = {"encoding": found.encoding, "errors": found.errors} if found else {}
        if number == 0:
            sys.stdin = open(0, closefd=False, **how)  # noqa: SIM115
            continue
        raw = _Standard(number, "w", closefd=False)
        lines = number == 2 or raw.isatty()
        through = bool(found) and found.write_through
        buffer = io.BufferedWriter(raw)
        setattr(
            sys, name, io.TextIOWrapper(buffer, line_buffering=lines, write_through=through, **how)
        )


def _open_on_nothing(number: int) -> None:
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, number)
    if nothing != number:
        os.close(nothing)
    os.set_inheritable(number, True)


@contextmanager
def lacks_explained() -> Iterator[None]:
    """End the command with exit code 1 in one sentence where the system lacks what it needs."""
    try:
        _check()
        yield
    except Exception as error:
        sentence = _lack(error)
        if sentence is None:
            raise
        _say(sentence)
        raise SystemExit(1) from None


def _check() -> None:
    """Raise OSError for what all commands need; allow as many open files as they may need."""
    try:
        os.getcwd()
    except FileNotFoundError:
        gone = "the working folder no longer exists. Change to another folder."
        raise OSError(gone) from None
    soft, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if 0 <= soft < _ENOUGH:
        soft = min(_ENOUGH, most) if most >= 0 else _ENOUGH
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, most))
        if soft < _FEW:
            raise OSError(f"only {soft} files may be open at once. {_RAISE}")


def _lack(error: Exception) -> str | None:
    """What the system lacked, in a sentence or two; None for an error of another kind."""
    if not isinstance(error, OSError):  # some packages put the system's words into their errors
        said = str(error)
        lacking = [number for number in _REMEDIES if os.strerror(number) in said]
        return f"{os.strerror(lacking[0])}. {_REMEDIES[lacking[0]]}" if lacking else None
    said = error.strerror or " ".join(str(error).split())
    if said.startswith("No usable temporary directory"):  # of `tempfile`
        return "no folder for temporary files is writable. Set TMPDIR to a folder that is."
    where = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
    remedy = _REMEDIES.get(error.errno or 0)
    return f"{where}{said}. {remedy}" if remedy else where + said


def _say(sentence: str) -> None:
    with suppress(OSError, ValueError):
        sys.stderr.write(f"error: {visible(sentence)}\n")
        sys.stderr.flush()


def load() -> None:
    """Import what the roles of a run need."""
    import hertzloop.cli.node
    import hertzloop.loop.controller_node
    import hertzloop.loop.plant_node
    import hertzloop.processes.roles  # noqa: F401
    from hertzloop.cli import app
    from hertzloop.loop.plant_streams import versions_here

    app.built()
    versions_here()  # read from the disk, and kept


def collect_rarely() -> None:
    """Look for cycles of garbage rarely: compiling a kernel makes millions of objects that live
    long, and Python's usual thresholds take 7 % of the time of a first run."""
    gc.set_threshold(100_000, 50, 50)


def main() -> None:
    """Entry point: the command line, with imports that can be interrupted quietly."""
    collect_rarely()
    take_streams()
    with command_line() as imported, lacks_explained():
        from hertzloop.cli import app

        commands = app.built()
        app.load(sys.argv[1:])
        imported()
        app.main(commands)


if __name__ == "__main__":
    main()
