"""Faults at random moments of real runs, and what comes of them, as a table.

`python -m tests.faults.runs --tries 1000 --seed 1`: every try is a `hertzloop run`, in shared
memory or over the bus. One of its processes, or the launcher, is killed, crashes, stops for good or
for a while, is terminated or interrupted, while the run starts or is under way. After it: no hang,
no process left, the right cause, a recording that can be read. A run ends by itself, or, where it
has to go on (after a short pause), by an interrupt. `--results FILE` keeps what came of every try,
and goes on from there; `--at-once` runs share the machine.

What is lost of the streams is counted in ms of wall time: from the last time that the recorder's
file grew to the fault, if the fault kept the recorder from closing it.
"""

import argparse
import random
import secrets
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from hertzloop.studies.cases.journal import Journal, JournalError
from tests.faults import page
from tests.faults.inflict import Fault, NotUnderWay, Outcome, draw, inflict
from tests.tables import markdown

MOST_LOST_MS = 100.0
WAYS = ("shared memory", "bus")
# A word of the sentence on a mistake, and the heading of its column.
WRONG = {
    "it hangs": "hangs",
    "processes left": "processes left",
    "unreadable": "unreadable",
    "cause": "wrong cause",
    "exit code": "wrong exit code",
    "other": "otherwise wrong",
}

Tried = dict[int, Outcome | None]  # by number; None: over, or not under way in time


def known(journal: Journal) -> Tried:
    """What came of the tries in a journal."""
    rows = journal.done.values()
    return {row["case"]: Outcome(**row["outcome"]) if row["outcome"] else None for row in rows}


def attempted(fault: Fault) -> Outcome | str:
    """What came of a fault, or why it was not tried."""
    try:
        with tempfile.TemporaryDirectory() as folder:
            return inflict(fault, Path(folder))
    except NotUnderWay as error:
        return str(error)


def series(faults: dict[int, Fault], at_once: int) -> Iterator[tuple[int, Outcome | str]]:
    """What came of each, as they end; an interrupt waits for those that are under way."""
    pool = ThreadPoolExecutor(at_once)
    futures = {pool.submit(attempted, fault): number for number, fault in faults.items()}
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def table(faults: list[Fault], tried: Tried) -> str:
    """A row for each process; what went wrong in no try is a sentence."""
    found: dict[str, list[tuple[str, Outcome]]] = defaultdict(list)
    for number, outcome in tried.items():
        if outcome:
            found[faults[number].victim].append((faults[number].way, outcome))
    everything = [one for outcomes in found.values() for _, one in outcomes]
    counted = [word for word in WRONG if _count(everything, word)]
    head = (
        "process",
        *(f"tries, {way}" for way in WAYS),
        *(WRONG[word] for word in counted),
        "most lost, ms",
        "longest, s",
    )
    rows = []
    for process, outcomes in sorted(found.items()):
        mine = [one for _, one in outcomes]
        rows.append(
            [
                process,
                *(sum(used == way for used, _ in outcomes) for way in WAYS),
                *(_count(mine, word) for word in counted),
                f"{max(one.lost_ms for one in mine):.0f}",
                f"{max(one.seconds for one in mine):.0f}",
            ]
        )
    never = ", ".join(WRONG[word] for word in WRONG if word not in counted)
    wrong = sum(bool(one.wrong) for one in everything)
    lost = sum(one.lost_ms > MOST_LOST_MS for one in everything)
    return (
        f"{markdown(head, rows)}\n\n{len(everything)} tries: something is wrong after "
        f"{wrong}, more than {MOST_LOST_MS:.0f} ms are lost after {lost}. "
        f"In no try: {never or 'none of the columns'}. "
        f"{len(tried) - len(everything)} further runs ended before the fault."
    )


def _count(outcomes: list[Outcome], word: str) -> int:
    """Number of tries with a mistake of a kind; "other": of none of the kinds."""
    if word == "other":
        kinds = [kind for kind in WRONG if kind != "other"]
        return sum(any(not any(w in said for w in kinds) for said in one.wrong) for one in outcomes)
    return sum(any(word in said for said in one.wrong) for one in outcomes)


def bad(outcome: Outcome | None) -> bool:
    """Whether something should not be."""
    return outcome is not None and bool(outcome.wrong or outcome.lost_ms > MOST_LOST_MS)


def main() -> int:
    """Print the table; 1 if something was wrong."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--tries", type=int, default=1000)
    options.add_argument("--seed", type=int, default=secrets.randbits(32))
    options.add_argument("--at-once", type=int, default=1, help="tries that share the machine")
    options.add_argument("--results", type=Path, help="a file to keep, and to go on from")
    wish = "write the table to docs/evidence/faults.md"
    options.add_argument("--page", action="store_true", help=wish)
    given = options.parse_args()
    print(f"seed {given.seed}", flush=True)
    random_ = random.Random(given.seed)
    faults = [draw(random_) for _ in range(given.tries)]
    with tempfile.TemporaryDirectory() as folder:
        try:
            journal = Journal(given.results or Path(folder) / "results", {"seed": given.seed})
        except JournalError as error:
            options.error(str(error))
        with journal, suppress(KeyboardInterrupt):  # then the table of what was tried until then
            open_ = {n: fault for n, fault in enumerate(faults) if n not in journal.done}
            for number, found in series(open_, given.at_once):
                outcome = found if isinstance(found, Outcome) else None
                journal.add({"case": number, "outcome": outcome and asdict(outcome)})
                if bad(outcome) or not outcome:
                    print(f"try {number}, {faults[number]}: {found}", file=sys.stderr, flush=True)
    tried = known(journal)
    print(made := table(faults, tried))
    if given.page:
        words = f"python -m tests.faults.runs --tries {given.tries} --seed {given.seed}"
        words += f" --at-once {given.at_once}" if given.at_once > 1 else ""
        page.put("runs", words, made)
    return int(any(map(bad, tried.values())))


if __name__ == "__main__":
    sys.exit(main())
