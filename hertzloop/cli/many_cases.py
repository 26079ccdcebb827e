"""Commands that run many cases: they continue after an interruption, and count failed cases."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hertzloop.cli.terminal import err, fail, if_interrupted
from hertzloop.studies.cases.journal import FinishedCases, kept
from hertzloop.studies.cases.workers import WorkersLost

CONTINUE = "Run the same command again to continue"


@contextmanager
def cases_are_kept(explain: Callable[[], str], target: str) -> Iterator[None]:
    """End the command with one sentence if its cases cannot be finished.

    That is after an interruption (exit code 130), after a lost worker, or if a file cannot be
    written (exit code 1).

    Args:
        explain: Returns a clause on the finished cases: where they are, and how to continue.
        target: What is written, for an error that names no file.
    """
    try:
        with if_interrupted(explain):
            yield
    except WorkersLost as error:
        fail(f"{error}; {explain()}.", 1)
    except OSError as error:
        reason = error.strerror or error  # an error of Arrow has no number
        fail(f"cannot write {error.filename or target}: {reason}; {explain()}.", 1)


@contextmanager
def resumable(folder: Path, name: str, header: dict[str, Any]) -> Iterator[FinishedCases]:
    """Keep finished cases in a journal, so that the same command continues after an interruption.

    Args:
        folder: Folder of the journal.
        name: Name of the command.
        header: Everything that decides the cases. A journal with another header is not continued.

    Yields:
        The cases that an earlier start of the command has finished.
    """
    kept_cases = "no case is finished"
    with (
        cases_are_kept(lambda: kept_cases, f"to the folder {folder}"),
        kept(folder, name, header) as finished,
    ):
        path = finished.journal.path
        kept_cases = f"finished cases are kept in {path}. {CONTINUE}"
        if finished.found:
            err.say(f"Continuing with {finished.found} finished cases of {path}.")
        for line in finished.journal.damaged:
            err.say(f"line {line} of {path} was damaged. Its case is run again.")
        yield finished


def end_if_failed(reasons: Sequence[str], total: int) -> None:
    """End the command with exit code 1 if cases failed, and print the most frequent reasons.

    Args:
        reasons: The reason of each failed case.
        total: Number of all cases.
    """
    if not reasons:
        return
    counted = Counter(reasons).most_common()
    for reason, times in counted[:3]:
        err.say(f"{times} times: {reason}" if times > 1 else reason)
    if len(counted) > 3:
        err.print(f"... and {len(counted) - 3} more reasons")
    fail(f"{len(reasons)} of {total} cases failed", 1)
