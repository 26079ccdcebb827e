"""Deliberate faults, one at a time: `python -m tests.mutants bus recordings --tries 40 --seed 1`.

Draws mutations that cosmic-ray's operators make of the folders' files (compiled kernels apart),
puts each into a copy of the sources, and runs the tests that know the module, quick ones first.
Prints those that no test notices as diffs, and a table by folder. The file of `--results` says all
of it, a line a mutant; what is in it is not tried again. Put "equivalent" for "survived" there for
what changes nothing at run time: it then counts apart.
"""

import argparse
import difflib
import hashlib
import json
import secrets
import sys
from collections import Counter
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tests.mutants.listing import Mutation, draw, mutated, mutations, sources
from tests.mutants.trying import Busy, Copy, copy_of
from tests.tables import markdown

ROOT = Path(__file__).resolve().parent.parent.parent
OUTCOMES = ("killed", "timed out", "survived", "equivalent")

Row = dict[str, Any]  # a line of the file of results


def table(rows: list[Row]) -> str:
    """A line a folder: how many were tried, what came of them, and how many of those that change
    behaviour were noticed; a hang counts as noticed."""
    lines = []
    for folder in sorted({row["path"].split("/")[0] for row in rows}):
        counts = Counter(row["outcome"] for row in rows if row["path"].split("/")[0] == folder)
        noticed = counts["killed"] + counts["timed out"]
        share = noticed / max(noticed + counts["survived"], 1)
        numbers = (counts[outcome] for outcome in OUTCOMES)
        lines.append((folder, counts.total(), *numbers, f"{share:.1%}"))
    return markdown(("folder", "tried", *OUTCOMES, "noticed"), lines)


def drawn(root: Path, folder: str, tries: int, seed: int) -> list[Mutation]:
    """`tries` mutations of a folder."""
    found = [mutation for path in sources(root, folder) for mutation in mutations(root, path)]
    kept: list[Mutation] = []
    for mutation in draw(found, f"{seed} {folder}"):
        if len(kept) == tries:
            break
        if mutated((root / mutation.path).read_text(), mutation) is not None:
            kept.append(mutation)
    return kept


def try_one(copy: Copy, mutation: Mutation) -> Row:
    """What the tests that know its file say of one mutant."""
    text = (copy.root / mutation.path).read_text()
    changed = mutated(text, mutation)
    assert changed is not None
    outcome, files = copy.attempt(mutation.path, changed)
    diff = difflib.unified_diff(
        text.splitlines(), changed.splitlines(), mutation.path, mutation.path, lineterm="", n=2
    )
    said = "" if outcome == "survived" else copy.output()
    return {
        **asdict(mutation),
        "outcome": outcome,
        "diff": "\n".join(diff),
        "tests": files,
        "said": said,
        "of": digest(text),
    }


def digest(text: str) -> str:
    """Of the source that a mutation was made of: after an edit it may be another."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def mutation_of(row: Row) -> Mutation:
    """The mutation that a line of results is of."""
    return Mutation(row["path"], row["line"], row["operator"], row["occurrence"])


def run(copy: Copy, chosen: list[Mutation], rows: list[Row], results: Path | None = None) -> None:
    """Try mutants in turn, and add a row each to `rows` and to the file of results."""
    for number, mutation in enumerate(chosen, 1):
        row = try_one(copy, mutation)
        rows[:] = [old for old in rows if mutation_of(old) != mutation] + [row]
        if results is not None:
            results.write_text("".join(json.dumps(row) + "\n" for row in rows))
        where = f"{mutation.path}:{mutation.line} {mutation.operator}"
        print(f"{number}/{len(chosen)} {where}: {row['outcome']}", flush=True)
        if row["outcome"] == "survived":
            print(row["diff"], flush=True)


def main() -> int:
    """Exit code: 1 if a mutant survived."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", help="as bus, or hertzloop/loop")
    parser.add_argument("--tries", type=int, default=40, help="mutants of each folder")
    parser.add_argument("--seed", type=int, default=secrets.randbits(32))
    parser.add_argument(
        "--seconds",
        type=float,
        default=60.0,
        help="processor time of tests for a mutant: of its folder's, and of others",
    )
    parser.add_argument("--default-tier", action="store_true", help="no tests but of this tier")
    parser.add_argument("--results", type=Path, help="a file that is read, and written")
    given = parser.parse_args()
    rows = read(given.results)
    print(f"seed {given.seed}", flush=True)
    try:
        with (
            copy_of(ROOT, given.seconds, given.default_tier) as copy,
            suppress(KeyboardInterrupt),
        ):
            for folder in given.folders:
                done = {mutation_of(row) for row in rows}
                new = drawn(ROOT, folder, given.tries, given.seed)
                chosen = [mutation for mutation in new if mutation not in done]
                run(copy, chosen, rows, given.results)
    except Busy as error:
        print(error, file=sys.stderr)
        return 2
    print(table(rows))
    return any(row["outcome"] == "survived" for row in rows)


def read(results: Path | None) -> list[Row]:
    """Results so far, of files that are what they were."""
    if results is None or not results.exists():
        return []
    rows = [json.loads(line) for line in results.read_text().splitlines()]
    kept = [row for row in rows if digest((ROOT / row["path"]).read_text()) == row["of"]]
    if len(kept) < len(rows):
        print(f"{len(rows) - len(kept)} results are of files that have changed; left out")
    return kept


if __name__ == "__main__":
    sys.exit(main())
