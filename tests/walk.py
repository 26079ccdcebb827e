"""The way of a run through the files: every function once, in the order of the first calls.

    python -m tests.walk
    python -m tests.walk --mergers 180

A stay is a visit to a file. A return is a stay in a file that was visited before. `--mergers`
prints which files would have to become one for so many returns, each time those that save most.
"""

import argparse
import json
import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import redirect_stdout
from itertools import groupby, pairwise
from pathlib import Path
from types import CodeType, FrameType

HOME = Path(__file__).resolve().parents[1]
FOLDERS = tuple(
    f"{HOME / name}{os.sep}"
    for name in ("hertzloop", "plant", "sensors", "controller", "bus", "recordings")
)
RUN = ["run", "aluminium-20mm", "--transport", "compiled", "--set", "run.duration_s=0.005"]


def walked() -> list[tuple[str, str]]:
    """File and name of each function of a run in this process, imports included."""
    seen: set[CodeType] = set()
    found: list[tuple[str, str]] = []

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != "call" or code in seen:
            return
        seen.add(code)
        file = os.path.realpath(code.co_filename)
        if file.startswith(FOLDERS) and not code.co_name.startswith("<"):
            found.append((os.path.relpath(file, HOME), code.co_qualname))

    with tempfile.TemporaryDirectory() as folder:
        sys.argv = ["hertzloop", *RUN, "--out", f"{folder}/a.mcap"]
        threading.setprofile(note)
        sys.setprofile(note)
        try:
            from hertzloop.__main__ import main

            main()
        except SystemExit as ended:
            if ended.code:
                raise
        finally:
            sys.setprofile(None)
            threading.setprofile(None)  # type: ignore[arg-type]
    return found


def returns(files: list[str]) -> int:
    """Visits to a file that was visited before, of the files in the order of the calls."""
    stays = [file for file, _ in groupby(files)]
    return len(stays) - len(set(stays))


def mergers(files: list[str], target: int) -> Iterator[tuple[str, str, int]]:
    """Two files that become one, and the returns that are left, until these are `target`."""
    while returns(files) > target:
        tried = []
        for one, other in {tuple(sorted(pair)) for pair in pairwise(files)}:
            # A file with kernels takes names from few others.
            if one != other and one.endswith("kernels.py") == other.endswith("kernels.py"):
                joined = [one if file == other else file for file in files]
                tried.append((returns(joined), one, other, joined))
        left, one, other, files = min(tried)
        yield one, other, left


def main() -> None:
    """Print the stays, then their number, that of the files and that of the returns, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mergers", type=int, metavar="RETURNS")
    target = parser.parse_args().mergers
    with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
        found = walked()
    stays = [(file, [name for _, name in some]) for file, some in groupby(found, lambda f: f[0])]
    for file, names in stays:
        print(f"{file}: {' '.join(names)}")
    order = [file for file, _ in stays]
    files = len(set(order))
    print(json.dumps({"stays": len(stays), "files": files, "returns": returns(order)}))
    if target is not None:
        for one, other, left in mergers(order, target):
            print(f"{left} {one} {other}")


if __name__ == "__main__":
    main()
