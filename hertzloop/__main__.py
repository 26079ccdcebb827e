"""python -m hertzloop, and the command `hertzloop`"""

import atexit
import os
import signal
import sys
from types import FrameType

from hertzloop.processes.signals import INTERRUPTED, hear_lost_interrupts, raise_when_ended


def _leave(number: int, frame: FrameType | None) -> None:
    """End at once: an exception in the middle of an import may come out as anything."""
    sys.stderr.write("interrupted\n")
    sys.stderr.flush()
    os._exit(INTERRUPTED)


_code: list[int] = []  # to end with, whatever Python would make of it


def _end() -> None:
    """After an interrupt that came through exec(), as imports use it, Python ends by SIGINT at
    last, however it was handled: this is before that, and after all that has to be done."""
    if _code:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(_code[0])


atexit.register(_end)  # the first to be registered, so the last to run


def load() -> None:
    """Import what the roles of a run need."""
    import hertzloop.loop.controller_node
    import hertzloop.loop.plant_node
    import hertzloop.processes.roles  # noqa: F401
    from hertzloop.commands import cli

    cli.built()


def main() -> None:
    """Entry point: the command line, with imports that can be interrupted quietly."""
    before = signal.signal(signal.SIGINT, _leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # a launcher holds it back
    from hertzloop.commands import cli

    commands = cli.built()
    raise_when_ended()
    if before == signal.SIG_IGN:
        signal.signal(signal.SIGINT, before)
    lost = hear_lost_interrupts()
    try:
        cli.main(commands)
    except Exception:
        if lost.is_set():  # and compiling, say, has failed for want of what it was to bring
            _leave(signal.SIGINT, None)
        raise
    except SystemExit as end:
        if end.code == INTERRUPTED:
            # Another one, while Python ends, would come out as an exception.
            raise_when_ended(lambda *_: os._exit(INTERRUPTED))
            _code.append(INTERRUPTED)
        raise


if __name__ == "__main__":
    main()
