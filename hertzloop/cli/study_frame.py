"""What the commands of studies share: cases that are finished stay so."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hertzloop.cli.terminal import err, fail, if_interrupted
from hertzloop.studies.sweeps.journal import JournalEntries, kept
from hertzloop.studies.sweeps.pool import SweepFailed


@contextmanager
def resumable(folder: Path, name: str, header: dict[str, Any]) -> Iterator[JournalEntries]:
    """Work on many cases that goes on where an earlier start of it was cut short, if one was;
    `header` says what decides the cases. Ends the command where they cannot be finished."""
    on = "no case is finished"
    try:
        with kept(folder, name, header) as finished:
            path = finished.journal.path
            on = f"finished cases are kept in {path}. Run the same command again to continue"
            if finished.found:
                err.say(f"Continuing with {finished.found} finished cases of {path}.")
            for line in finished.journal.damaged:
                err.say(f"line {line} of {path} was damaged. Its case is run again.")
            try:
                with if_interrupted(lambda: on):
                    yield finished
            except SweepFailed as error:
                fail(f"{error}; {on}.", 1)
    except OSError as error:
        fail(f"cannot write to the folder {folder}: {error.strerror or error}; {on}.", 1)
