"""The mutations that cosmic-ray's operators make of a source file, and a draw of them."""

import ast
import random
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import MutationVisitor
from cosmic_ray.operators.provider import OperatorProvider
from parso.tree import NodeOrLeaf

from hertzloop.common.jit.folder import kernel_sources

Place = tuple[int, int]  # line, from 1, and column, from 0

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
    """All mutations of a file but those of compiled functions and of what type checkers read."""
    text = (root / path).read_text()
    nodes = [node for node in ast_nodes(get_ast(text)) if not _inert(node)]
    left_out = _left_out(text)
    found = []
    for name, operator in OPERATORS.items():
        places = (at for node in nodes for at, _ in operator().mutation_positions(node))
        for occurrence, at in enumerate(places):
            if not any(first <= at < end for first, end in left_out):
                found.append(Mutation(path, at[0], name, occurrence))
    return found


def mutated(text: str, mutation: Mutation) -> str | None:
    """The changed text of a file; None if that is no Python, or the same program."""
    changed = MutationVisitor.mutate_code(text, OPERATORS[mutation.operator](), mutation.occurrence)
    try:
        with warnings.catch_warnings(action="ignore"):  # as of "is" with a number
            compile(changed or "", mutation.path, "exec", dont_inherit=True)
        same = changed is None or ast.dump(ast.parse(changed)) == ast.dump(ast.parse(text))
    except SyntaxError:
        return None
    return None if same else changed


def draw(found: list[Mutation], seed: str) -> Iterator[Mutation]:
    """One mutation a line, the lines in random order: a line with many operators, each of which
    can be replaced by eleven others, counts like any other."""
    chance = random.Random(seed)
    lines: dict[tuple[str, int], list[Mutation]] = {}
    for mutation in sorted(found):
        lines.setdefault((mutation.path, mutation.line), []).append(mutation)
    for line in chance.sample(sorted(lines), len(lines)):
        yield chance.choice(lines[line])


def _left_out(text: str) -> list[tuple[Place, Place]]:
    """Where a file says what has no effect when it runs, as annotations, or is compiled."""
    parts: list[ast.AST | None] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.arg | ast.AnnAssign):
            parts.append(node.annotation)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            parts.append(node.returns)
            if node.name in _OF_A_LAW or "kernel" in map(_name, node.decorator_list):
                parts += [*node.decorator_list, node]
            parts += [one for one in node.decorator_list if _name(one) in _FOR_TYPE_CHECKERS]
        elif isinstance(node, ast.If) and _name(node.test) == "TYPE_CHECKING":
            parts += [node.test, *node.body]
        elif isinstance(node, ast.Call) and _name(node.func) == "cast":
            parts.append(node.args[0])
    lines = text.splitlines()

    def place(line: int, byte: int) -> Place:
        return line, len(lines[line - 1].encode()[: max(byte, 0)].decode())

    return [
        # from one column before on, where a decorator has its @
        (place(part.lineno, part.col_offset - 1), place(part.end_lineno, part.end_col_offset))
        for part in parts
        if part is not None
    ]


def _inert(node: NodeOrLeaf) -> bool:
    """Whether no operator changes a node, as most of them: said here, it is asked once."""
    return node.type in ("name", "string", "newline") or (
        node.type == "operator" and node.value in _PUNCTUATION
    )


def _name(node: ast.expr) -> str:
    return getattr(node, "attr", "") or getattr(node, "id", "")
