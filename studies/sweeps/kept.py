"""Cases that are simulated once, whatever asks for them: noted in a journal as they finish.

A search or a chart asks for the same cases in the same order whenever it is started with the same
words, since its seed is one of them. So what was finished before a kill is read instead of run,
and the rest follows as if there had been no kill.
"""

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hertzloop.analysis.cases import Span
from studies.sweeps.evaluate import Numbered, Pool, Rows, chunked
from studies.sweeps.journal import Journal


class Kept:
    """Finished cases of what one command does, in an open journal.

    `found`: how many an earlier start had finished; `ran`: how many were run since.
    """

    def __init__(self, journal: Journal) -> None:
        self.journal = journal
        self.found, self.ran = len(journal.done), 0

    def of(self, pool: Pool) -> Pool:
        """The same pool, which is asked for a case once only."""

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
def kept(folder: Path, name: str, header: dict[str, Any]) -> Iterator[Kept]:
    """The finished cases of a command in FOLDER/NAME-DIGEST.partial, where the digest is that of
    `header`: all that decides which cases are asked for, and their bits. The file goes when the
    work is done. Raises JournalError, OSError."""
    path = folder / f"{name}-{_digest(header)[:8]}.partial"
    with Journal(path, header) as journal:
        yield Kept(journal)
    path.unlink()


def _digest(what: Any) -> str:
    return hashlib.blake2b(json.dumps(what, sort_keys=True).encode(), digest_size=12).hexdigest()
