"""A long series of faults drawn at random, and its table: of `tests.faults.runs`, `attacks` and
`studies`."""

import argparse
import random
import secrets
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.tables import markdown


@dataclass
class Outcome:
    """What came of a fault; `wrong` says in words what should not be."""

    seconds: float
    said: str = ""
    wrong: list[str] = field(default_factory=list)
    lost_ms: float = 0.0


class NotReached(Exception):
    """What was to be disturbed did not get going, or was over, before anything was done to it."""


def series(
    about: str | None,
    draw: Callable[[random.Random], Any],
    tried: Callable[[Any, Path], Outcome],
    kinds: Sequence[str],
) -> int:
    """Try as many faults as the command line asks for, each in a folder of its own; print those
    after which something is wrong, and a row for each kind: these fields of a fault.

    Returns:
        the exit code: 1 if something was wrong.
    """
    options = argparse.ArgumentParser(description=about)
    options.add_argument("--tries", type=int, default=60)
    options.add_argument("--seed", type=int, default=secrets.randbits(32))
    options.add_argument("--at-once", type=int, default=1, help="tries that share the machine")
    given = options.parse_args()
    print(f"seed {given.seed}", flush=True)
    random_ = random.Random(given.seed)
    found: dict[tuple[str, ...], list[Outcome]] = defaultdict(list)

    def one(fault: Any) -> None:
        try:
            with tempfile.TemporaryDirectory() as folder:
                outcome = tried(fault, Path(folder))
        except NotReached as error:
            print(f"{fault}: {error}", file=sys.stderr, flush=True)
            return
        found[tuple(str(getattr(fault, kind)) for kind in kinds)].append(outcome)
        if outcome.wrong:
            print(f"{fault}: {outcome}", file=sys.stderr, flush=True)

    with ThreadPoolExecutor(given.at_once) as pool, suppress(KeyboardInterrupt):
        try:
            for _ in pool.map(one, [draw(random_) for _ in range(given.tries)]):
                pass
        finally:  # an interrupt waits for those that are under way
            pool.shutdown(cancel_futures=True)
    rows = [
        (
            *kind,
            len(outcomes),
            sum(bool(one.wrong) for one in outcomes),
            f"{max(one.lost_ms for one in outcomes):.0f}",
            f"{max(one.seconds for one in outcomes):.0f}",
        )
        for kind, outcomes in sorted(found.items())
    ]
    head = (*kinds, "tries", "something wrong", "most lost, ms", "longest, s")
    print(markdown(head, rows, len(kinds)))
    return int(any(one.wrong for outcomes in found.values() for one in outcomes))
