"""Deliberate faults, one at a time: `python -m tests.mutants bus recordings --tries 40 --seed 1`.

Draws mutations that cosmic-ray's operators make of the folders' files (compiled kernels apart),
puts each into a copy of the sources, and runs the tests of its folder, then the others for a time.
Prints those that no test notices as diffs, and a table by folder.
"""

import argparse
import difflib
import os
import random
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from contextlib import suppress
from pathlib import Path

import psutil

from tests.mutants.listing import Mutation, draw, mutated, mutations, sources
from tests.tables import markdown

ROOT = Path(__file__).resolve().parent.parent.parent
OUTCOMES = ("killed", "timed out", "survived")
_NOT_COPIED = (".git", "__pycache__", ".*_cache", ".venv", "venv", ".hypothesis")
_MARK = "HERTZLOOP_MUTANTS"  # in the environment of all that a test starts, and its children
_LIMIT_S = 1200.0  # of the tests of a folder; each has the limit of its own of the test suite
_CHECKS = "tests/test_checks.py"  # fails for the form of a mutant, whatever it does


def table(found: dict[str, Counter[str]]) -> str:
    """A line a folder: how many were tried, what came of them, and the share that was noticed; a
    hang counts as noticed."""
    lines = []
    for folder, counts in found.items():
        noticed = counts.total() - counts["survived"]
        numbers = (counts[outcome] for outcome in OUTCOMES)
        lines.append((folder, counts.total(), *numbers, f"{noticed / max(counts.total(), 1):.1%}"))
    return markdown(("folder", "tried", *OUTCOMES, "noticed"), lines)


def drawn(folder: str, tries: int, seed: int) -> list[Mutation]:
    """`tries` mutations of a folder."""
    found = [mutation for path in sources(ROOT, folder) for mutation in mutations(ROOT, path)]
    kept: list[Mutation] = []
    for mutation in draw(found, f"{seed} {folder}"):
        if len(kept) == tries:
            break
        if mutated((ROOT / mutation.path).read_text(), mutation) is not None:
            kept.append(mutation)
    return kept


def own_tests(path: str) -> list[str]:
    """Test files of the folder that mirrors a module's: as tests/fitting/fit/ and tests/bus/."""
    parts = path.split("/")[:-1]
    for size in range(len(parts), 0, -1):
        for folder in ("/".join(parts[:size]), "/".join(parts[1:size])):
            if folder and (ROOT / "tests" / folder).is_dir():
                return _test_files(ROOT / "tests" / folder)
    return []


def _test_files(folder: Path) -> list[str]:
    found = (path.relative_to(ROOT).as_posix() for path in folder.rglob("test_*.py"))
    return sorted(path for path in found if path != _CHECKS)


def attempt(tree: Path, mutation: Mutation, tier: list[str], seconds: float) -> str:
    """What tests do with a mutant in a copy of the sources."""
    near = own_tests(mutation.path)
    others = [test for test in _test_files(ROOT / "tests") if test not in near]
    random.Random(str(mutation)).shuffle(others)
    path, text = tree / mutation.path, (ROOT / mutation.path).read_text()
    path.write_text(mutated(text, mutation) or "")
    try:
        code = run(tree, [*tier, *near], _LIMIT_S) if near else 0
        if code is None:
            return "timed out"
        if code in (0, 5) and run(tree, [*tier, *others], seconds) in (None, 0, 5):
            return "survived"  # 5: no test of the tier in these files
        return "killed"
    finally:
        path.write_text(text)


def run(tree: Path, words: list[str], limit_s: float) -> int | None:
    """Exit code of pytest in a copy of the sources up to its first failure; None at the limit."""
    command = [sys.executable, "-P", "-m", "pytest", "-x", "-q", "-n", "0", "-p"]
    own = {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1", _MARK: str(tree)}
    process = subprocess.Popen(
        [*command, "no:cacheprovider", *words],
        cwd=tree,
        env=os.environ | own,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        return process.wait(limit_s)
    except subprocess.TimeoutExpired:
        return None
    finally:  # a mutant may keep a run from ending its processes
        process.kill()
        process.wait()
        for left in psutil.process_iter():
            with suppress(psutil.Error, OSError):
                if left.environ().get(_MARK) == str(tree):
                    left.send_signal(signal.SIGKILL)


def main() -> int:
    """Exit code: 1 if a mutant survived."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", help="as bus, or hertzloop/loop")
    parser.add_argument("--tries", type=int, default=40, help="mutants of each folder")
    parser.add_argument("--seed", type=int, default=secrets.randbits(32))
    parser.add_argument("--seconds", type=float, default=60.0, help="for the tests of others")
    parser.add_argument("--default-tier", action="store_true", help="no tests but of this tier")
    given = parser.parse_args()
    print(f"seed {given.seed}", flush=True)
    tier = ["-m", "not full and not soak"] if given.default_tier else []
    found = {folder: Counter[str]() for folder in given.folders}
    with tempfile.TemporaryDirectory() as folder, suppress(KeyboardInterrupt):
        tree = Path(folder) / "tree"
        shutil.copytree(ROOT, tree, symlinks=True, ignore=shutil.ignore_patterns(*_NOT_COPIED))
        for name, counts in found.items():
            for mutation in drawn(name, given.tries, given.seed):
                outcome = attempt(tree, mutation, tier, given.seconds)
                counts[outcome] += 1
                print(f"{mutation}: {outcome}", flush=True)
                if outcome == "survived":
                    text = (ROOT / mutation.path).read_text()
                    both = (text.splitlines(), (mutated(text, mutation) or "").splitlines())
                    print(*difflib.unified_diff(*both, lineterm="", n=2), sep="\n", flush=True)
    print(table(found))
    return any(counts["survived"] for counts in found.values())


if __name__ == "__main__":
    sys.exit(main())
