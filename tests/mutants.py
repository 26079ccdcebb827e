"""Deliberate faults, one at a time: `python -m tests.mutants bus recordings --tries 40 --seed 1`.

Draws mutations that cosmic-ray's operators make of the folders' files (compiled kernels apart),
puts each into a copy of the sources, and runs the tests of its folder, then the others for a time.
Prints those that no test notices as diffs, and a table by folder.
"""

import argparse
import ast
import difflib
import os
import random
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import MutationVisitor
from cosmic_ray.operators.provider import OperatorProvider
from parso.tree import NodeOrLeaf

from hertzloop.common.jit.folder import kernel_sources
from tests.tables import markdown

ROOT = Path(__file__).resolve().parent.parent
OUTCOMES = ("killed", "timed out", "survived")
_NOT_COPIED = (".git", "__pycache__", ".*_cache", ".venv", "venv", ".hypothesis")
_MARK = "HERTZLOOP_MUTANTS"  # in the environment of all that a test starts, and its children
_LIMIT_S = 1200.0  # of the tests of a folder; each has the limit of its own of the test suite
_CHECKS = "tests/test_checks.py"  # fails for the form of a mutant, whatever it does


# Operators that need to be told two variables, and then insert random numbers, are left out.
OPERATORS = {
    name: OperatorProvider()[name]
    for name in OperatorProvider()
    if not OperatorProvider()[name].arguments()
}
_PUNCTUATION = (*"()[]{},.:=", "->")
_FOR_TYPE_CHECKERS = {"overload", "override", "final"}  # decorators
_OF_A_LAW = {"command", "command_ahead", "known_ahead", "trigger_level"}  # compiled with a loop


@dataclass(frozen=True, order=True)
class Mutation:
    """One change: which occurrence of what an operator finds in a file; `path` is beside the
    root of the sources."""

    path: str
    line: int
    operator: str
    occurrence: int


def sources(root: Path, folder: str) -> list[str]:
    """Files below `folder` that mutations are made of: neither generated nor compiled code."""
    compiled = kernel_sources()
    found = (path.relative_to(root).as_posix() for path in (root / folder).rglob("*.py"))
    return sorted(
        path
        for path in found
        if not {path, f"hertzloop/{path}"} & compiled.keys()
        and not path.endswith(("_pb2.py", "kernels.py"))
    )


def mutations(root: Path, path: str) -> list[Mutation]:
    """All mutations of a file."""
    nodes = [node for node in ast_nodes(get_ast((root / path).read_text())) if not _inert(node)]
    found = []
    for name, operator in OPERATORS.items():
        places = (at for node in nodes for at, _ in operator().mutation_positions(node))
        found += [Mutation(path, at[0], name, number) for number, at in enumerate(places)]
    return found


def mutated(text: str, mutation: Mutation) -> str | None:
    """The changed text of a file; None if that is no Python, or does the same but for compiled
    functions."""
    changed = MutationVisitor.mutate_code(text, OPERATORS[mutation.operator](), mutation.occurrence)
    try:
        with warnings.catch_warnings(action="ignore"):  # as of "is" with a number
            compile(changed or "", mutation.path, "exec", dont_inherit=True)
        before, after = ast.parse(text), ast.parse(changed or text)
    except SyntaxError:
        return None
    compiled = {
        node.name
        for node in ast.walk(before)
        if isinstance(node, ast.FunctionDef) and "kernel" in map(_name, node.decorator_list)
    }
    program = _Program(_OF_A_LAW | compiled)
    same = ast.dump(program.visit(before)) == ast.dump(program.visit(after))
    return None if same else changed


class _Program(ast.NodeTransformer):
    """Leaves of a module what has an effect when it runs, without functions of some names."""

    def __init__(self, left_out: set[str]) -> None:
        self.left_out = left_out

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.annotation = None
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        node.annotation = ast.Constant("")
        return self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST | None:
        node.returns = None
        node.decorator_list = [d for d in node.decorator_list if _name(d) not in _FOR_TYPE_CHECKERS]
        return None if node.name in self.left_out else self.generic_visit(node)

    def visit_If(self, node: ast.If) -> ast.AST | None:
        return None if _name(node.test) == "TYPE_CHECKING" else self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        return self.generic_visit(node.args[1] if _name(node.func) == "cast" else node)


def draw(found: list[Mutation], seed: str) -> Iterator[Mutation]:
    """One mutation a line, the lines in random order: a line with many operators, each of which
    can be replaced by eleven others, counts like any other."""
    chance = random.Random(seed)
    lines: dict[tuple[str, int], list[Mutation]] = {}
    for mutation in sorted(found):
        lines.setdefault((mutation.path, mutation.line), []).append(mutation)
    for line in chance.sample(sorted(lines), len(lines)):
        yield chance.choice(lines[line])


def _inert(node: NodeOrLeaf) -> bool:
    """Whether no operator changes a node, as most of them: said here, it is asked once."""
    return node.type in ("name", "string", "newline") or (
        node.type == "operator" and node.value in _PUNCTUATION
    )


def _name(node: ast.expr) -> str:
    return getattr(node, "attr", "") or getattr(node, "id", "")


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
