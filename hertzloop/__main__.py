"""python -m hertzloop, and the command `hertzloop`."""

import atexit
import errno
import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from hertzloop.common.sanitize import visible
from hertzloop.processes import signals


def collect_rarely() -> None:
    """Look for cycles of garbage rarely: compiling a kernel makes millions of objects that live
    long, and Python's usual thresholds take 7 % of the time of a first run."""
    gc.set_threshold(100_000, 50, 50)


@contextmanager
def command_line() -> Iterator[None]:
    """End the process with one sentence if a signal or the system ends what is inside.

    Exit code 130 after a signal, 1 after an error of the system such as a full disk.
    """
    code: list[int] = []

    def end() -> None:
        if code:
            # At once: zenoh's threads may still call Python, which then aborts.
            os._exit(code[0])

    atexit.register(end)  # before the imports: the first to be registered is the last to run
    signals.install_handlers()
    try:
        try:
            yield
        finally:
            _flush()
    except KeyboardInterrupt:
        code.append(_say("interrupted", signals.INTERRUPTED))
    except BrokenPipeError:  # nobody reads the results any more
        code.append(1)
    except OSError as error:
        code.append(_say(f"error: {_sentence(error)}", 1))
    except SystemExit as ended:
        code.append(ended.code if isinstance(ended.code, int) else int(ended.code is not None))
    except Exception:
        # A compiler may lose the KeyboardInterrupt and then fail for want of its result.
        if not signals.received.is_set():
            raise
        code.append(_say("interrupted", signals.INTERRUPTED))
    else:
        code.append(0)
    sys.exit(code[0])


def _flush() -> None:
    """Write out the results. Raises OSError, BrokenPipeError if nobody reads them any more."""
    try:
        print(end="", flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OSError(f"cannot write standard output: {error.strerror}") from None


def _sentence(error: OSError) -> str:
    where = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
    remedy = ". Free some space." if error.errno == errno.ENOSPC else ""
    return where + (error.strerror or " ".join(str(error).split())) + remedy


def _say(sentence: str, code: int) -> int:
    with suppress(OSError):
        print(visible(sentence), file=sys.stderr, flush=True)
    return code


def main() -> None:
    """Run the command line."""
    collect_rarely()
    with command_line():
        from hertzloop.cli import app

        # Before typer runs, which says nothing of an interrupt in an import.
        app.import_called(sys.argv[1:])
        app.main(app.root_command())


if __name__ == "__main__":
    main()
