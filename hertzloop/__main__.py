"""python -m hertzloop, and the command `hertzloop`"""

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

import gc

from hertzloop.processes.signals import command_line
from hertzloop.processes.surroundings import lacks_explained, take_streams


def load() -> None:
    """Import what the roles of a run need."""
    import hertzloop.cli.node
    import hertzloop.loop.controller_node
    import hertzloop.loop.plant_node
    import hertzloop.processes.roles  # noqa: F401
    from hertzloop.bus.streams import versions_here
    from hertzloop.cli import app

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
