"""Finished cases of a search, kept in a journal by their values.

A search asks for the same cases in the same order when it is started again, since its seed is
given.
"""

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hertzloop.results.spans import Span
from hertzloop.studies.cases.evaluate import Numbered, Pool, chunked
from hertzloop.studies.cases.journal import Journal
from hertzloop.studies.cases.rows import Rows


class FinishedCases:
    """Finished cases of a search in an open journal.

    Attributes:
        journal: The journal.
        found: Number of cases that an earlier start has finished.
        ran: Number of cases that were run since.
    """

    def __init__(self, journal: Journal) -> None:
        self.journal = journal
        self.found, self.ran = len(journal.done), 0

    def skipping_finished(self, pool: Pool) -> Pool:
        """Return a pool that runs only the cases that the journal lacks, each of them once."""

        def results(toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
            setup = _digest([toml, span])
            open_: Numbered = []
            named: dict[int, str] = {}  # of the cases to run
            again: dict[str, list[int]] = {}  # the numbers under which a case is wanted
            for number, values in (case for chunk in chunks for case in chunk):
                name = _digest([setup, values])
                if name not in self.journal.done and name not in again:
                    open_.append((number, values))
                    named[number] = name
                again.setdefault(name, []).append(number)
            for rows in pool(toml, span, chunked(open_)):
                for row in rows:
                    self.journal.add({"case": named[row["case"]], "row": row})
                self.ran += len(rows)
            for name, numbers in again.items():
                row = self.journal.done[name]["row"]
                yield [row | {"case": number} for number in numbers]

        return results


@contextmanager
def kept(folder: Path, name: str, header: dict[str, Any]) -> Iterator[FinishedCases]:
    """Open the journal of a search, FOLDER/NAME-DIGEST.partial; remove it when the work is done.

    Args:
        folder: Folder of the journal.
        name: Name of the work.
        header: All that decides which cases are asked for, and their bits; the digest is of this.

    Raises:
        JournalError: the journal is in use, or damaged.
        OSError: the journal cannot be written.
    """
    path = folder / f"{name}-{_digest(header)[:8]}.partial"
    with Journal(path, header) as journal:
        yield FinishedCases(journal)
    path.unlink()


def _digest(what: Any) -> str:
    return hashlib.blake2b(json.dumps(what, sort_keys=True).encode(), digest_size=12).hexdigest()
